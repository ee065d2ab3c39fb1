"""Figures of whole trainings, from trainings that are none."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from lndrl.bench.gpu import whole
from lndrl.bench.gpu.parts import Outcome
from lndrl.bench.gpu.plan import full_plan
from lndrl.errors import UserError
from tests.lndrl.bench.test_train import row


class Script:
    """A training that has all its rows and validated versions at once."""

    def __init__(self, actors: Sequence[int], shares: Sequence[float]) -> None:
        self.rows = [row(update) for update in range(len(actors))]
        for each, count in zip(self.rows, actors, strict=True):
            each["time"]["actors"] = count
        self.shares = shares
        self.given: list[tuple[Any, ...]] = []

    def __call__(self, *arguments: Any) -> Script:
        self.given.append(arguments)
        return self

    def __enter__(self) -> Script:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def curve(self) -> list[dict[str, Any]]:
        return [
            {
                "elapsed": 30.0 * (number + 1),
                "steps": 1000 * (number + 1),
                "sampled": {"arrived": round(100 * share), "episodes": 100},
            }
            for number, share in enumerate(self.shares)
        ]

    def wait(self, done: Callable[[Any], bool], interval: float) -> list[dict[str, Any]]:
        for count in range(len(self.rows) + 1):
            if done(self.rows[:count]):
                return self.rows[:count]
        return self.rows


def measure(monkeypatch, script: Script, work: Callable[..., None], left: float = 600.0):
    monkeypatch.setattr(whole, "Training", script)
    outcome = Outcome()
    try:
        work(outcome.add, time.monotonic() + left, full_plan())
    except UserError as error:
        outcome.add(str(error), "raised")
    return outcome.figures


def test_what_is_timed_begins_when_all_actors_are_there(monkeypatch) -> None:
    script = Script([1] * 3 + [full_plan().actors] * 9, [])
    figures = measure(monkeypatch, script, whole.rates)
    for way in ("no_graphs", "graphs"):
        assert figures[way]["steps_per_second"] == pytest.approx(100.0)
        assert figures[way]["updates"] == 4, "of 10 s each: at least four, and 20 s"
    options = [arguments[3] for arguments in script.given]
    assert options == [["--device", "cuda", "--actors", str(full_plan().actors)]] * 2
    graphs = [next(s for s in arguments[5] if "graphs" in s) for arguments in script.given]
    assert graphs == ["learner.cuda_graphs=false", "learner.cuda_graphs=true"]


def test_fewer_actors_make_a_figure_and_no_updates_none(monkeypatch) -> None:
    few = measure(monkeypatch, Script([0] * 6, []), whole.rates)
    assert few["graphs"]["actors"] == 0 and few["graphs"]["updates"] == 4
    none = measure(monkeypatch, Script([0], []), whole.rates)
    assert none["raised"].startswith("2 of 2 failed, the first is no_graphs: 1 update in ")
    assert set(none["errors"]) == {"no_graphs", "graphs"}


def test_the_first_version_that_arrives_often_enough_counts(monkeypatch) -> None:
    script = Script([4] * 8, [0.1, 0.76, 0.9])
    figures = measure(monkeypatch, script, whole.arrivals)
    assert figures["reached"] and (figures["minutes"], figures["steps"]) == (1.0, 2000)
    assert figures["curve"] == [[0.5, 1000, 0.1], [1.0, 2000, 0.76], [1.5, 3000, 0.9]]
    assert 0.0 <= figures["minutes_until_known"] < 1.0
    (arguments,) = script.given
    assert arguments[4].name == "lndrl.yaml" and "learner.validation_share=1.0" in arguments[5]


def test_a_target_that_is_missed_is_said_and_no_validation_is_a_failure(monkeypatch) -> None:
    figures = measure(monkeypatch, Script([4] * 8, [0.1, 0.7]), whole.arrivals)
    assert not figures["reached"] and "minutes" not in figures
    assert figures["steps_per_second"] == pytest.approx(100.0)
    none = measure(monkeypatch, Script([4] * 8, []), whole.arrivals)
    assert none["raised"].startswith("nothing was validated in 0 s, 8 updates")


def test_a_run_leaves_no_folder(monkeypatch) -> None:
    script = Script([4] * 8, [0.9])
    measure(monkeypatch, script, whole.arrivals)
    assert not Path(script.given[0][1]).exists()
