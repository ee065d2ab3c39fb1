"""Code in the pages: Python runs, files are what the program reads."""

from __future__ import annotations

import contextlib
import io
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from lndrl.config import RunConfig, keys, load_config, load_scenario
from lndrl.models import Model
from lndrl.navigation import action_table
from lndrl.placement.cluster import ClusterConfig
from lndrl.scenario import Scenario
from tests.docs.pages import PAGES, ROOT, Block, blocks, name_of

ALL = [block for page in PAGES for block in blocks(page)]
ELSEWHERE = {
    "docs/gymnasium.md": "tests/lndrl/navigation/environment/test_page.py",
    "docs/deployment.md": "tests/lndrl/test_deployment_page.py",
    **{
        f"docs/extend/{part}.md": "tests/lndrl/test_extend_pages.py"
        for part in ("encoder", "metric", "network", "planner", "reward", "scenario")
    },
}
"""Pages whose Python a test of its own runs, with what it needs."""
GIVEN: dict[str, Any] = {
    "docs/guard.md": {
        "actions": action_table(load_config("lndrl").task),
        "grid": None,
        "pose": None,
        "ranges": np.full(720, 12.0),
        "bearings": np.linspace(-1.5, 1.5, 720),
        "command": (0.4, 0.0),
        "velocity": (0.2, 0.0),
        "age": 0.1,
    }
}
"""What a page's Python takes for granted."""
KINDS: tuple[type[Model], ...] = (RunConfig, ClusterConfig, Scenario)


def place(block: Block) -> str:
    return f"{block.page}:{block.line}"


@pytest.mark.parametrize("block", [b for b in ALL if b.language == "python"], ids=place)
def test_python_runs(block: Block, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if block.page in ELSEWHERE:
        test = (ROOT / ELSEWHERE[block.page]).read_text()
        assert Path(block.page).name in test
        compile(block.text, block.page, "exec")
        return
    monkeypatch.chdir(tmp_path)
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(block.text, block.page, "exec"), dict(GIVEN.get(block.page, {})))


def test_the_map_that_the_page_draws_is_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    page = list(blocks(ROOT / "docs/your-own-map.md"))
    (drawn,) = [block for block in page if block.language == "python"]
    first, second = [block for block in page if block.language == "yaml"]
    exec(compile(drawn.text, drawn.page, "exec"), {})
    plain = yaml.safe_load(first.text)
    more = yaml.safe_load(second.text)
    for content in (plain, {**plain, **more}):
        Path("building-scenario.yaml").write_text(yaml.safe_dump(content))
        found = load_scenario("building-scenario.yaml")
        assert found.name == "building" and found.kind == "map"


@pytest.mark.parametrize(
    "block", [b for b in ALL if b.language in ("yaml", "toml", "json")], ids=place
)
def test_files_are_what_the_program_reads(block: Block) -> None:
    if block.language == "toml":
        assert tomllib.loads(block.text)
        return
    data = yaml.safe_load(block.text)  # JSON is YAML
    assert wrong_keys(data) == []


def wrong_keys(data: dict[str, Any]) -> list[str]:
    """Keys that are none of the model which has the first; other programs' files have none."""
    names = set(data) - {"base"}
    likest = max(KINDS, key=lambda model: len(names & set(model.model_fields)))
    if not names & set(likest.model_fields):
        return []
    return [key for key in dotted(data) if key not in known(likest) and key != "base"]


def known(model: type[Model]) -> set[str]:
    return set(keys(model))


def dotted(data: Any, prefix: str = "") -> list[str]:
    """Dotted keys of what is nested; entries of lists stand below the list's name."""
    if isinstance(data, list):
        return [key for each in data for key in dotted(each, prefix)]
    if not isinstance(data, dict):
        return []
    found = []
    for key, value in data.items():
        name = f"{prefix}{key}"
        found.append(name)
        if not prefix.endswith(("terms.", "settings.")):
            found += dotted(value, f"{name}.")
    return [key for key in found if "terms." not in key and "settings." not in key]


def test_wrong_keys_are_seen() -> None:
    assert wrong_keys({"base": "lndrl.yaml", "ppo": {"gama": 0.9}}) == ["ppo.gama"]
    assert wrong_keys({"run": "first", "learner": {"hosts": "a"}}) != []
    assert wrong_keys({"ppo": {"gamma": 0.9}}) == []


def test_every_page_with_blocks_is_read() -> None:
    assert {name_of(page) for page in PAGES} >= set(ELSEWHERE) | set(GIVEN)
    assert len(ALL) >= 25
