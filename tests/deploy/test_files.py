"""Files for containers, systemd and clouds: what they copy, call and need is there."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement

from lndrl.cli.main import SUMMARIES, load_command
from lndrl.placement.cluster import load_cluster

ROOT = Path(__file__).resolve().parents[2]
DEPLOY = ROOT / "deploy"
UNITS = sorted(DEPLOY.glob("*.service"))


def commands() -> Iterator[tuple[str, list[str]]]:
    """(where, words) of every lndrl command line in deploy/."""
    for unit in UNITS:
        (line,) = re.findall(r"^ExecStart=(.*)$", unit.read_text(), re.MULTILINE)
        yield unit.name, shlex.split(line)[1:]
    services = yaml.safe_load((DEPLOY / "container/compose.yaml").read_text())["services"]
    for name in ("actors", "metrics"):
        yield f"compose.yaml: {name}", services[name]["command"]
    yield "compose.yaml: learner", shell_words(services["learner"]["command"][0])
    for file in ("learner", "actors"):
        for resource in yaml.safe_load_all((DEPLOY / f"kubernetes/base/{file}.yaml").read_text()):
            pod = resource.get("spec", {}).get("template", {}).get("spec", {})
            for container in pod.get("containers", []):
                words = container["args"]
                words = shell_words(words[0]) if "command" in container else words
                yield f"{file}.yaml: {container['name']}", words
    cloud = yaml.safe_load((DEPLOY / "skypilot.yaml").read_text())
    yield "skypilot.yaml", shell_words(cloud["run"].splitlines()[-1])
    cluster = load_cluster(DEPLOY / "cluster.yaml")
    for job in (cluster.learner("lndrl", False), cluster.learner("", True), *cluster.others()):
        yield f"cluster.yaml: {job.name}", [*job.words, "--certs", "certs"]


def shell_words(line: str) -> list[str]:
    """The arguments of lndrl in a shell's line: a choice becomes its second part."""
    line = re.sub(r"\$+\(.*\|\| echo (\w+)\)", r"\1", " ".join(line.split()))
    line = re.sub(r"\"?\$\w+\"?", "tls/learner:7447", line)
    words = shlex.split(line)
    return words[next(i for i, w in enumerate(words) if w.endswith("lndrl")) + 1 :]


@pytest.mark.parametrize(("where", "words"), list(commands()), ids=lambda v: str(v)[:40])
def test_every_command_line_is_one_of_the_program(where: str, words: list[str]) -> None:
    name, *rest = words
    assert name in SUMMARIES, where
    load_command(name).make_context(name, rest)  # raises for an option that there is not


def test_files_name_each_other_by_where_they_are() -> None:
    texts = [f for f in DEPLOY.rglob("*") if f.suffix in (".md", ".yaml", ".yml", ".sbatch", "")]
    for file in filter(Path.is_file, texts):
        for named in re.findall(r"(?<![\w/])deploy/[\w./-]*\w", file.read_text()):
            assert (ROOT / named).exists(), f"{file.relative_to(ROOT)} names {named}"


def test_containers_copy_what_is_there_and_may_be_seen() -> None:
    text = (DEPLOY / "container/Containerfile").read_text()
    seen = [
        line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line[0] == "!"
    ]
    copied = [line.split()[1:-1] for line in text.splitlines() if line.startswith("COPY ")]
    sources = [s for words in copied for s in words if not s.startswith(("--", "/opt"))]
    for source in sources:
        assert (ROOT / source).exists(), source
        assert source.split("/")[0] in seen, source
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]
    wanted = {*wheel["targets"]["wheel"]["packages"], "configs", "deploy"}
    assert wanted <= {source.split("/")[0] for source in sources}
    assert "USER 10001" in text and "HEALTHCHECK" in text and text.count("\nFROM ") == 2


def test_images_hold_all_that_runs_and_nothing_of_development() -> None:
    done = subprocess.run(
        [sys.executable, "deploy/container/runtime.py", "requirements.lock"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    names = {line.partition("==")[0].lower().replace("_", "-") for line in done.stdout.split()}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    for requirement in (*project["dependencies"], *extras["fleet"]):
        assert Requirement(requirement).name.lower() in names, requirement
    for requirement in (*extras["export"], *extras["dev"]):
        assert Requirement(requirement).name.lower() not in names - {"lndrl"}, requirement


def test_the_learner_of_compose_is_reached_by_its_certificates_name() -> None:
    text = (DEPLOY / "container/compose.yaml").read_text()
    found: dict[str, Any] = yaml.safe_load(text)
    assert "--host learner" in text and "learner" in found["services"]
    for service in found["services"].values():
        assert service["read_only"] and service["cap_drop"] == ["ALL"]


@pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="needs systemd-analyze, which is not installed"
)
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_units_are_right(unit: Path, tmp_path: Path) -> None:
    # Of a program that is there: whether it is, is the only thing that depends on the machine.
    text = unit.read_text().replace("/srv/lndrl/.venv/bin/lndrl", "/bin/true")
    (tmp_path / unit.name).write_text(re.sub(r"^User=.*$", "User=root", text, flags=re.MULTILINE))
    done = subprocess.run(
        ["systemd-analyze", "verify", str(tmp_path / unit.name)], capture_output=True, text=True
    )
    said = [line for line in done.stderr.splitlines() if unit.name in line]
    assert done.returncode == 0 and not said, done.stderr
