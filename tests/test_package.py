"""What is installed: the wheel, what it says about itself, and the Python that make chooses."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest
import yaml

from lndrl.version import VERSION

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout, built without a network."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel as it lies in site-packages."""
    folder = tmp_path_factory.mktemp("site-packages")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def tracked(*folders: str) -> set[str]:
    """Files of the checkout below ``folders``, without what running leaves behind."""
    return {
        str(path.relative_to(ROOT))
        for folder in folders
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_the_wheel_holds_code_types_and_configurations_and_nothing_else(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    code = tracked("lndrl", "actors", "learner")
    assert {f"{package}/py.typed" for package in ("lndrl", "actors", "learner")} <= code
    about = f"lndrl-{VERSION}.dist-info/"
    at_start = {"lndrl.pth", "_lndrl_registration.py"}
    assert {name for name in held if not name.startswith(about)} == code | at_start | {
        f"lndrl/{name}" for name in tracked("configs")
    }
    assert {f"{about}licenses/LICENSE", f"{about}licenses/NOTICE"} <= held


def test_the_wheel_says_what_it_is(installed: Path) -> None:
    text = (installed / f"lndrl-{VERSION}.dist-info/METADATA").read_text()
    about = Parser().parsestr(text)
    assert about["Version"] == VERSION and about["Requires-Python"] == ">=3.11"
    classifiers = about.get_all("Classifier", [])
    for minor in (11, 12, 13):
        assert f"Programming Language :: Python :: 3.{minor}" in classifiers
    assert "Typing :: Typed" in classifiers
    assert about.get_all("Project-URL") == ["Paper, https://arxiv.org/abs/2303.12354"]


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (["config", "show", "drl_laser"], "scan_encoder: fan"),
        (["config", "show"], "calibration"),
        (["scenarios", "--json"], '"name": "office"'),
        (["sweep", "smoke", "--table"], "sweep smoke: how episodes end"),
        (["benchmark", "--table"], "results/benchmark"),
        (["train", "lndlr"], "did you mean lndrl? known by name: drl_laser, "),
    ],
)
def test_commands_of_the_wheel_work_in_an_empty_folder(
    installed: Path, tmp_path: Path, arguments: list[str], shown: str
) -> None:
    environment = {**os.environ, "PYTHONPATH": str(installed), "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-m", "lndrl", *arguments]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert shown in done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_shipped_configurations_are_those_of_the_wheel(installed: Path, tmp_path: Path) -> None:
    code = "import lndrl.config as c; print(c.REPOSITORY_CONFIGS)"
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.stdout.strip() == str(installed / "lndrl/configs")


def test_gymnasium_knows_the_environment_where_the_wheel_is_installed(
    installed: Path, tmp_path: Path
) -> None:
    code = (
        f"import site, sys; sys.path.insert(0, {str(installed)!r}); site.addsitedir(sys.path[0])\n"
        "import gymnasium; assert 'lndrl' not in sys.modules\n"
        "print(gymnasium.spec('lndrl/Navigation-v0').entry_point)\n"
        "import lndrl.registration; print(lndrl.registration.__file__)"
    )
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.stdout.split() == [
        "lndrl.navigation.environment:NavigationEnv",
        str(installed / "lndrl/registration.py"),
    ], done.stderr


def test_the_citation_names_this_version_and_the_paper() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (citation["version"], citation["license"]) == (VERSION, PROJECT["license"])
    assert citation["references"][0]["url"] == PROJECT["urls"]["Paper"]


def test_the_change_log_knows_this_version() -> None:
    assert f"{VERSION}" in (ROOT / "CHANGELOG.md").read_text()


def chosen_python(folder: Path, *arguments: str) -> str:
    """What ``make install`` would make ``.venv`` with, where ``folder`` is all that it can find."""
    for tool in ("make", "sh"):
        found = next(Path(p, tool) for p in os.environ["PATH"].split(":") if Path(p, tool).exists())
        (folder / tool).symlink_to(found)
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHON", "MAKEFLAGS")}
    done = subprocess.run(
        ["make", "--dry-run", "--no-print-directory", "VENV=none", "install", *arguments],
        cwd=ROOT,
        env={**environment, "PATH": str(folder)},
        capture_output=True,
        text=True,
    )
    (line,) = [
        line
        for line in (done.stdout + done.stderr).splitlines()
        if "-m venv" in line or "***" in line
    ]
    return line


def program(folder: Path, name: str, does: str) -> None:
    (folder / name).write_text(f"#!/bin/sh\n{does}\n")
    (folder / name).chmod(0o755)


def test_make_takes_the_newest_python_that_runs(tmp_path: Path) -> None:
    program(tmp_path, "python3.13", "exit 127")  # as pyenv's shim of one that is switched off
    program(tmp_path, "python3.12", f'exec {sys.executable} "$@"')
    program(tmp_path, "python3.11", f'exec {sys.executable} "$@"')
    assert "|| python3.12 -m venv none" in chosen_python(tmp_path)


def test_make_takes_the_python_that_it_is_told(tmp_path: Path) -> None:
    program(tmp_path, "python3.12", f'exec {sys.executable} "$@"')
    assert "|| python3.99 -m venv none" in chosen_python(tmp_path, "PYTHON=python3.99")


def test_make_says_that_no_python_runs(tmp_path: Path) -> None:
    program(tmp_path, "python3", "exit 1")  # older than 3.11, by what it was asked
    assert "no Python from 3.11 on runs here; install one or say make PYTHON=" in chosen_python(
        tmp_path
    )


def test_ci_keeps_to_one_python() -> None:
    assert 'PYTHON="${PYTHON:-python3.11}"' in (ROOT / ".ci/run").read_text()


def test_a_schema_goes_with_every_shipped_kind(installed: Path) -> None:
    for path in (installed / "lndrl/configs/schemas").iterdir():
        assert json.loads(path.read_text())["$schema"].endswith("2020-12/schema")
