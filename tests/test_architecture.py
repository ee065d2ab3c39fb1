"""The house: who may import whom, and how large a room may be."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FLOORS = {
    "lndrl": 0,
    "lndrl.errors": 0,
    "lndrl.models": 0,
    "lndrl.scenario": 0,
    "lndrl.config": 0,
    "lndrl.randomness": 0,
    "lndrl.version": 0,
    "lndrl.maps": 0,
    "lndrl.world": 1,
    "lndrl.localization": 1,
    "lndrl.transport": 1,
    "lndrl.doctor": 2,
    "lndrl.navigation": 2,
    "lndrl.policy": 3,
    "lndrl.planners": 3,
    "lndrl.evaluation": 4,
    "lndrl.view": 4,
    "actors": 5,
    "learner": 5,
    "lndrl.chaos": 5,
    "lndrl.bench": 6,
    "lndrl.cli": 6,
    "lndrl.__main__": 6,
}
# Rooms of one floor that must not know each other.
STRANGERS = [{"lndrl.world", "lndrl.localization", "lndrl.transport"}, {"actors", "learner"}]
# Libraries that stay in the rooms they serve.
LIBRARIES = {
    "torch": {
        "lndrl.policy",
        "lndrl.planners",
        "lndrl.evaluation",
        "lndrl.view",
        "actors",
        "learner",
        "lndrl.bench",
        "lndrl.cli",
    },
    "zenoh": {"lndrl.transport", "lndrl.doctor"},
    "typer": {"lndrl.cli"},
}
PICKLERS = {"pickle", "cPickle", "_pickle", "cloudpickle", "dill", "joblib", "shelve", "marshal"}
LONGEST_FILE = 450
FILES = sorted(
    path for top in ("lndrl", "actors", "learner") for path in (ROOT / top).rglob("*.py")
)


def module_of(path: Path) -> str:
    """Dotted name of a file below the root; a package's __init__ is the package."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(module: str) -> str:
    """The room a dotted name belongs to: lndrl's children, or actors, or learner."""
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] == "lndrl" else parts[0]


def imports_of(tree: ast.AST, module: str, is_package: bool) -> Iterator[tuple[int, str]]:
    """(line, dotted name) of everything a file imports, at any depth, relative ones resolved."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = module.split(".") if is_package else module.split(".")[:-1]
                up = package[: len(package) - node.level + 1]
                base = ".".join([*up, base] if base else up)
            for alias in node.names:
                # `from lndrl import config` names a room; `from lndrl.config import X` does not.
                yield node.lineno, f"{base}.{alias.name}" if base == "lndrl" else base


def violations(source: str, module: str, is_package: bool = False) -> list[str]:
    """What the imports of ``source``, as ``module``, break."""
    room = room_of(module)
    found = []
    for line, name in imports_of(ast.parse(source), module, is_package):
        top, other = name.split(".")[0], room_of(name)
        where = f"{module}:{line} imports {name}"
        if top in PICKLERS:
            found.append(f"{where}: pickle runs whatever it is sent")
        if top in LIBRARIES and room not in LIBRARIES[top]:
            found.append(f"{where}: {top} stays in {', '.join(sorted(LIBRARIES[top]))}")
        if top not in ("lndrl", "actors", "learner") or other == room:
            continue
        if other not in FLOORS:
            found.append(f"{where}: {other} has no floor")
        elif FLOORS[other] > FLOORS[room]:
            found.append(f"{where}: floor {FLOORS[other]} from floor {FLOORS[room]}")
        elif any({room, other} <= strangers for strangers in STRANGERS):
            found.append(f"{where}: {room} and {other} do not know each other")
    return found


def test_files_are_found() -> None:
    assert {"lndrl.config", "lndrl.cli.main", "actors", "learner"} <= set(map(module_of, FILES))


def test_every_room_has_a_floor() -> None:
    assert {room_of(module_of(path)) for path in FILES} <= set(FLOORS)


@pytest.mark.parametrize("path", FILES, ids=module_of)
def test_imports_go_down(path: Path) -> None:
    is_package = path.name == "__init__.py"
    assert violations(path.read_text(), module_of(path), is_package) == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("lndrl.maps.grid", "from lndrl.world import World"),
        ("lndrl.maps.grid", "from lndrl import navigation"),
        ("lndrl.maps.grid", "from ..world import World"),
        ("lndrl.world.world", "import lndrl.localization.amcl"),
        ("lndrl.navigation.task", "def f():\n    from lndrl.policy import PolicyRunner"),
        ("lndrl.view.draw", "from lndrl.cli.main import main"),
        ("actors.rollout", "from learner.ppo import loss"),
        ("learner.ppo", "import actors.rollout"),
        ("learner.checkpoint", "import pickle"),
        ("lndrl.transport.messages", "import torch.nn as nn"),
        ("learner.service", "import zenoh"),
        ("lndrl.world.world", "from lndrl.somewhere import x"),
    ],
)
def test_wrong_imports_are_seen(module: str, source: str) -> None:
    assert len(violations(source, module)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("lndrl.world.world", "from lndrl.maps import OccupancyGrid"),
        ("lndrl.world.world", "from .laser import scan"),
        ("lndrl.planners.policy", "from lndrl.policy import PolicyRunner"),
        ("lndrl.cli.training", "from actors.fleet import run_fleet\nimport learner.service"),
    ],
)
def test_right_imports_pass(module: str, source: str) -> None:
    assert violations(source, module) == []


@pytest.mark.parametrize("path", FILES, ids=module_of)
def test_nothing_is_loaded_through_pickle(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            called = f"{node.value.id}.{node.attr}"
            assert called not in ("torch.load", "torch.save"), f"line {node.lineno}: {called}"
        if isinstance(node, ast.keyword):
            assert node.arg != "allow_pickle" or not getattr(node.value, "value", True)


@pytest.mark.parametrize("path", FILES, ids=module_of)
def test_files_are_small_and_say_what_they_hold(path: Path) -> None:
    assert path.name not in ("utils.py", "util.py", "helpers.py", "common.py", "misc.py")
    text = path.read_text()
    assert len(text.splitlines()) <= LONGEST_FILE


@pytest.mark.parametrize(
    "path", [path for path in FILES if path.parts[-2] in ("actors", "learner")], ids=module_of
)
def test_the_loops_fit_on_one_screen(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef):
            assert (node.end_lineno or 0) - node.lineno < 60, node.name


def test_the_top_level_is_the_agreed_one() -> None:
    for name in ("pyproject.toml", "Makefile", "README.md", "LICENSE", "configs", "deploy"):
        assert (ROOT / name).exists(), name
