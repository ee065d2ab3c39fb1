"""The house: who may import whom, and how large a room may be."""

from __future__ import annotations

import ast
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from tests.conftest import LONGEST

ROOT = Path(__file__).resolve().parent.parent
FLOORS = {
    "lndrl": 7,  # the front door: nobody inside goes through it
    "lndrl.caches": 0,
    "lndrl.errors": 0,
    "lndrl.hints": 0,
    "lndrl.wording": 0,
    "lndrl.kernels": 0,
    "lndrl.extensions": 0,
    "lndrl.models": 0,
    "lndrl.machine": 0,
    "lndrl.numbering": 0,
    "lndrl.scenario": 0,
    "lndrl.config": 0,
    "lndrl.randomness": 0,
    "lndrl.registration": 0,
    "lndrl.version": 0,
    "lndrl.wilson": 0,
    "lndrl.maps": 0,
    "lndrl.world": 1,
    "lndrl.localization": 1,
    "lndrl.transport": 1,
    "lndrl.curve": 2,
    "lndrl.doctor": 2,
    "lndrl.navigation": 2,
    "lndrl.policy": 3,
    "lndrl.planners": 3,
    "lndrl.ahead": 4,
    "lndrl.evaluation": 4,
    "lndrl.robot": 4,
    "lndrl.view": 4,
    "actors": 5,
    "learner": 5,
    "lndrl.chaos": 5,
    "lndrl.placement": 5,
    "lndrl.bench": 6,
    "lndrl.cli": 6,
    "lndrl.__main__": 6,
    "learner.__main__": 6,
}
# Rooms within rooms, and the files at the door beside them: floors of the house they are in. The
# door is where a room has no entry of its own; a house's __init__ stands above all of it.
INNER_FLOORS = {
    "learner.timing": 0,
    "learner.ppo": 1,
    "learner.ppo.example": 1,
    "learner.run": 2,
    "learner.intake": 3,
    "learner.ranks": 4,
    "learner": 4,
    "lndrl.transport": 0,
    "lndrl.transport.security": 1,
    "lndrl.transport.zenoh": 2,
    "lndrl.robot.messages": 0,
    "lndrl.robot.link": 1,
    "lndrl.robot": 2,
    "lndrl.robot.stand_in": 3,
    "lndrl.robot.driving": 3,
    "lndrl.robot.bags": 4,
    "lndrl.view": 0,
    "lndrl.view.dashboard": 1,
    "lndrl.view.dashboard.worlds": 1,
    "lndrl.view.pictures": 1,
    "lndrl.view.pictures.learning": 1,
    "lndrl.view.playing": 2,
    "lndrl.view.monitoring": 1,
    "lndrl.view.tracking": 1,
    "lndrl.view.robots": 2,
    "lndrl.view.report": 2,
    "lndrl.cli": 0,
    "lndrl.cli.help": 0,
    "lndrl.cli.training": 1,
    "lndrl.cli.evaluation.bench": 1,
    "lndrl.cli.evaluation": 1,
    "lndrl.cli.fleet": 1,
    "lndrl.cli.robot": 1,
    "lndrl.cli.reporting": 1,
    "lndrl.cli.main": 2,
}
HOUSES = {"learner", "lndrl.transport", "lndrl.robot", "lndrl.view", "lndrl.cli"}
# Rooms of one floor of which the first must not know the second.
ONE_WAY = {
    ("lndrl.evaluation", "lndrl.view"),
    ("lndrl.evaluation", "lndrl.robot"),
    ("lndrl.robot", "lndrl.view"),
}
# Rooms of one floor that must not know each other.
STRANGERS = [
    {"lndrl.world", "lndrl.localization", "lndrl.transport"},
    {"actors", "learner"},
    {"lndrl.view.dashboard", "lndrl.view.pictures"},
    {"lndrl.view.dashboard", "lndrl.view.pictures.learning"},
    {"lndrl.cli.training", "lndrl.cli.evaluation", "lndrl.cli.fleet", "lndrl.cli.robot"},
    {"lndrl.robot.driving", "lndrl.robot.stand_in"},
    {"lndrl.cli.training", "lndrl.cli.evaluation.bench"},
    {"lndrl.cli.fleet", "lndrl.cli.evaluation.bench"},
]
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
    "zenoh": {"lndrl.transport", "lndrl.doctor", "lndrl.robot"},
    "rosbags": {"lndrl.robot"},
    "mcap": {"lndrl.robot"},
    "xxhash": {"lndrl.robot"},
    "typer": {"lndrl.cli"},
    "asyncssh": {"lndrl.placement", "lndrl.cli"},
    "submitit": {"lndrl.placement", "lndrl.cli"},
    "jinja2": {"lndrl.view"},
    "rerun": {"lndrl.view"},
    "imageio_ffmpeg": {"lndrl.view"},
    "mlflow": {"lndrl.view"},
    "wandb": {"lndrl.view"},
    "prometheus_client": {"lndrl.view", "learner", "lndrl.cli"},
}
PICKLERS = {"pickle", "cPickle", "_pickle", "cloudpickle", "dill", "joblib", "shelve", "marshal"}
LONGEST_FILE = 450
LONGEST_FUNCTION = 60
MOST_FILES = 15
# One long list of alike things each, better read in one place than in two.
LARGE_ROOMS = {"lndrl/chaos", "lndrl/localization"}
SERVICES = ("actors", "learner")
FILES = sorted(path for top in ("lndrl", *SERVICES) for path in (ROOT / top).rglob("*.py"))


def module_of(path: Path) -> str:
    """Dotted name of a file below the root; a package's __init__ is the package."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path) for path in FILES}


def room_of(module: str) -> str:
    """The room a dotted name belongs to: lndrl's children, or actors, or learner.

    What a service is started by from a shell stands where the command line does.
    """
    if module in FLOORS:
        return module
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] == "lndrl" else parts[0]


def inner_room_of(module: str) -> str:
    """The room within a house that a dotted name belongs to: the longest prefix that is one."""
    parts = module.split(".")
    prefixes = (".".join(parts[:n]) for n in range(len(parts), 0, -1))
    return next(prefix for prefix in prefixes if prefix in INNER_FLOORS)


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
                inner = f"{base}.{alias.name}"
                yield node.lineno, inner if base == "lndrl" or inner in MODULES else base


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
        if top not in ("lndrl", "actors", "learner"):
            continue
        if other == room:
            if room in HOUSES and module != room:
                found += [f"{where}: {why}" for why in inner_violations(module, name)]
        elif other not in FLOORS:
            found.append(f"{where}: {other} has no floor")
        elif FLOORS[other] > FLOORS[room]:
            found.append(f"{where}: floor {FLOORS[other]} from floor {FLOORS[room]}")
        elif any({room, other} <= strangers for strangers in STRANGERS):
            found.append(f"{where}: {room} and {other} do not know each other")
        elif (room, other) in ONE_WAY:
            found.append(f"{where}: {room} does not know {other}")
    return found


def inner_violations(module: str, name: str) -> list[str]:
    """What the import of ``name`` by ``module``, both of one house, breaks within it."""
    here, there = inner_room_of(module), inner_room_of(name)
    if name in HOUSES:
        return [f"the front door of {name} is for those outside"]
    if here == there:
        return []
    if any({here, there} <= strangers for strangers in STRANGERS):
        return [f"{here} and {there} do not know each other"]
    if INNER_FLOORS[there] > INNER_FLOORS[here]:
        return [f"inner floor {INNER_FLOORS[there]} from inner floor {INNER_FLOORS[here]}"]
    return []


def inner_rooms(files: Iterable[Path]) -> set[str]:
    """The folders of houses that hold any of ``files``: each wants a floor of its own."""
    folders = {".".join(path.relative_to(ROOT).parts[:-1]) for path in files}
    return {folder for folder in folders if room_of(folder) in HOUSES}


def long_functions(source: str) -> list[str]:
    """Functions of ``source`` that do not fit on one screen."""
    return [
        node.name
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef)
        and (node.end_lineno or 0) - node.lineno >= LONGEST_FUNCTION
    ]


def test_files_are_found() -> None:
    assert {"lndrl.config", "lndrl.cli.main", "actors", "learner"} <= set(map(module_of, FILES))


def test_every_room_has_a_floor() -> None:
    assert {room_of(module_of(path)) for path in FILES} <= set(FLOORS)


def test_every_inner_room_has_a_floor_and_every_floor_a_room() -> None:
    assert inner_rooms(FILES) <= set(INNER_FLOORS)
    assert set(INNER_FLOORS) <= MODULES
    assert {"learner.ppo", "lndrl.cli.fleet"} <= inner_rooms(FILES)


def test_a_room_is_seen_by_its_files_with_or_without_an_entry() -> None:
    files = [ROOT / "learner/attic/box.py", ROOT / "lndrl/cli/attic/shelf/box.py"]
    assert inner_rooms(files) == {"learner.attic", "lndrl.cli.attic.shelf"}


def test_every_folder_of_code_is_a_package() -> None:
    assert {path.parent for path in FILES} == {p.parent for p in FILES if p.name == "__init__.py"}


def test_a_room_with_many_files_has_rooms_within() -> None:
    files = Counter(
        str(path.parent.relative_to(ROOT)) for path in FILES if path.name != "__init__.py"
    )
    large = {folder for folder, count in files.items() if count > MOST_FILES}
    assert large == LARGE_ROOMS


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
        ("learner.ppo.update", "import actors.rollout"),
        ("learner.run.checkpoint", "import pickle"),
        ("lndrl.transport.messages", "import torch.nn as nn"),
        ("learner.service", "import zenoh"),
        ("lndrl.world.world", "from lndrl.somewhere import x"),
        ("lndrl.evaluation.sweep.folder", "from lndrl.view.text import clipped"),
        ("lndrl.evaluation.sweep.folder", "from lndrl.view import text"),
        # Rooms within rooms.
        ("learner.ppo.update", "from learner.run.checkpoint import save_checkpoint"),
        ("learner.ppo.update", "from learner.run import checkpoint"),
        ("learner.run.checkpoint", "from learner.intake.ledger import Ledger"),
        ("learner.intake.ingest", "from learner.learner import Learner"),
        ("learner.intake.ingest", "from learner import learner"),
        ("learner.timing", "from learner.ppo.update import PPO"),
        ("lndrl.transport.messages", "from lndrl.transport.security.identity import Security"),
        ("lndrl.transport.security.access", "from lndrl.transport.zenoh.session import ExitGuard"),
        ("lndrl.transport.zenoh.actor", "import zenoh\nfrom lndrl.view import text"),
        ("lndrl.transport.desk", "from lndrl.transport.zenoh import session"),
        ("lndrl.transport.zenoh.session", "from lndrl.transport import Welcome"),
        ("lndrl.view.dashboard.screen", "from lndrl.view.pictures.axes import styled"),
        ("lndrl.view.pictures.world", "from lndrl.view.dashboard import feed"),
        ("lndrl.view.progress", "from lndrl.view.pictures.axes import styled"),
        (
            "lndrl.cli.training.train_all",
            "from lndrl.cli.evaluation.bench.benchmark import RESULTS",
        ),
        ("lndrl.cli.evaluation.play", "from lndrl.cli.fleet.doctor import doctor"),
        ("lndrl.cli.fleet.learner", "from lndrl.cli.main import run"),
        ("lndrl.cli.options", "from lndrl.cli.training import local"),
        ("lndrl.world.world", "import lndrl"),
        ("lndrl.cli.training", "from lndrl import load_policy"),
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
        ("lndrl.cli.training.local", "from actors.fleet import run_fleet\nimport learner.service"),
        ("learner.intake.ingest", "from learner.run.events import EventLog"),
        ("learner.run.checkpoint", "from learner.ppo.update import PPO"),
        ("learner.ppo.update", "from learner.timing import TimeSplit"),
        ("lndrl.transport.zenoh.actor", "from lndrl.transport.security.identity import Security"),
        ("lndrl.view.dashboard.screen", "from lndrl.view.dashboard import panels"),
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


def in_a_service(path: Path) -> bool:
    """Whether a file belongs to actors or learner, in whichever of their rooms."""
    return path.relative_to(ROOT).parts[0] in SERVICES


@pytest.mark.parametrize("path", [path for path in FILES if in_a_service(path)], ids=module_of)
def test_the_loops_fit_on_one_screen(path: Path) -> None:
    assert long_functions(path.read_text()) == []


def test_a_loop_that_does_not_fit_is_seen_in_every_room() -> None:
    assert long_functions("def loop():\n" + "    pass\n" * LONGEST_FUNCTION) == ["loop"]
    rooms = {path.parent for path in filter(in_a_service, FILES)}
    assert {ROOT / "learner" / room for room in ("ppo", "intake", "run")} <= rooms


def test_the_top_level_is_the_agreed_one() -> None:
    for name in ("pyproject.toml", "Makefile", "README.md", "LICENSE", "configs", "deploy"):
        assert (ROOT / name).exists(), name


def test_types_are_checked_everywhere_and_as_strictly_in_tests() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]
    assert set(settings["files"]) == {"lndrl", *SERVICES, "tests", "docs/site"}
    assert settings["check_untyped_defs"] and "exclude" not in settings
    relaxed = [name for each in settings["overrides"] for name in each["module"]]
    assert not [name for name in relaxed if name.split(".")[0] in (*settings["files"], "*")]
    assert "\t$(BIN)/mypy\n" in (ROOT / "Makefile").read_text(), "with no arguments: all of them"


def test_the_files_that_are_begun_first_are_there() -> None:
    assert [name for name in LONGEST if not (ROOT / "tests" / name).is_file()] == []
