"""Planners of one's own as methods of the bench: settings, identity, and no row of other code."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from lndrl import extensions
from lndrl.errors import UserError
from lndrl.evaluation.benchmark import ResultsFolder, contenders, load_benchmark, method_runs
from lndrl.evaluation.benchmark.replay import contender_named
from lndrl.evaluation.benchmark.run import Plan

Write = Callable[..., str]
TEXT = """
    import numpy as np

    class Slow:
        name = "slow"
        def __init__(self, config, speed=0.2):
            self.speed = speed
        def reset(self, seed, worlds): pass
        def act(self, observation, rows):
            return np.tile([self.speed, 0.0], (len(rows), 1))
"""
ROOM = """
name: room
size: [6, 4]
pedestrians: {count: [0, 0]}
robot: [{start: [1, 1, 1.5, 3], goal: [4.5, 1, 5, 3]}]
"""


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Path]:
    """Writes a bench of one room with a method of the class, and the same with settings."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "room.yaml").write_text(ROOM)

    def write(name: str) -> Path:
        file = tmp_path / "bench.yaml"
        file.write_text(
            "scenarios: [room.yaml]\nset: [task.time_limit=2.0]\nmethods:\n"
            f"  slow: {{planner: '{name}'}}\n"
            f"  fast: {{planner: '{name}', settings: {{speed: 0.6}}}}\n"
            "  learned: {planner: runs/learned}\n"
        )
        return file

    return write


def test_methods_have_settings_and_rows_of_their_own(
    own_module: Write, bench: Callable[[str], Path], tmp_path: Path
) -> None:
    spec = load_benchmark(bench(f"{own_module(TEXT)}:Slow"))
    found, missing = contenders(spec)
    assert [each.name for each in found] == ["slow", "fast"] and missing == ["learned"]
    assert [each.actions for each in found] == ["rule", "rule"]
    folder = ResultsFolder(tmp_path / "results")
    Plan(folder, found, spec.scenarios, 2, 0, spec.changes).run(workers=0)
    distances = [
        [record.distance for record in folder.records(name, "room.yaml").values()]
        for name in ("slow", "fast")
    ]
    assert all(3 * 0.9 < fast / slow < 3 * 1.1 for slow, fast in zip(*distances, strict=True))


def test_rows_of_another_text_are_refused(
    own_module: Write, bench: Callable[[str], Path], tmp_path: Path
) -> None:
    module = own_module(TEXT)
    spec = load_benchmark(bench(f"{module}:Slow"))
    folder = ResultsFolder(tmp_path / "results")
    Plan(folder, contenders(spec)[0], spec.scenarios, 1, 0).missing()
    del sys.modules[module]
    own = Path(sys.path[0], f"{module}.py")
    own.write_text(own.read_text().replace("0.0]", "0.1]"))
    with pytest.raises(UserError, match="method slow has changed since it was tested there"):
        Plan(folder, contenders(spec)[0], spec.scenarios, 1, 0).missing()


def test_an_untrusted_method_is_refused(own_module: Write, bench: Callable[[str], Path]) -> None:
    module = own_module(TEXT, trusted=False)
    spec = load_benchmark(bench(f"{module}:Slow"))
    found, _ = contenders(spec)
    with pytest.raises(UserError, match=f"planner {module}:Slow is refused"):
        Plan(ResultsFolder(Path("results")), found, spec.scenarios, 1, 0)
    assert module not in sys.modules


def test_it_can_be_drawn_without_being_a_method(own_module: Write) -> None:
    name = f"{own_module(TEXT)}:Slow"
    contender = contender_named(load_benchmark(), name)
    assert (contender.name, contender.source.own) == ("Slow", True)
    assert contender.identity.startswith(f"{name} ")


def test_there_is_nothing_to_train(own_module: Write, bench: Callable[[str], Path]) -> None:
    file = bench("any_module:Slow")
    with pytest.raises(UserError, match="method slow is a rule, nothing to train"):
        method_runs(load_benchmark(file), file.parent, ["slow"])
    assert extensions.trusted_modules() == ()
