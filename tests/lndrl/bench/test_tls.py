"""What TLS costs, from turns; and the turns themselves, of two small trainings."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, cast

import pytest

from lndrl.bench import tls, training
from lndrl.bench.tls import Paused, Turn, alternate, figures
from lndrl.bench.training import Training
from lndrl.chaos.stage import descendants, lives

SMALL = [
    *("network.map_channels=[2,2,2]", "network.features=4", "network.goal_features=2"),
    *("ppo.batch_size=64", "ppo.minibatch_size=64", "learner.threads=1"),
    *("actor.worlds=2", "actor.horizon=16", "scenario=sparse"),
    *("localization.min_particles=50", "localization.max_particles=100"),
]


class Script:
    """A training that makes a row every ``seconds`` of a clock that is moved by hand."""

    folder = Path()

    def __init__(self, clock: list[float], steps: int, seconds: float) -> None:
        self.clock, self.steps, self.seconds = clock, steps, seconds
        self.rows: list[dict[str, Any]] = []
        self.calls: list[str] = []

    def wait(self, done, interval: float) -> list[dict[str, Any]]:
        while not done(self.rows):
            self.clock[0] += self.seconds
            row = {"steps": self.steps * (len(self.rows) + 1), "time": {"unix": self.clock[0]}}
            self.rows = [*self.rows, row]
        return self.rows

    def pause(self) -> None:
        self.calls.append("pause")

    def go_on(self) -> None:
        self.calls.append("go on")


def test_cost_is_of_medians_and_of_neighbours() -> None:
    turns = [Turn("plain", 100, 1.0), Turn("tls", 90, 1.0), Turn("plain", 300, 3.0)]
    turns += [Turn("tls", 190, 2.0), Turn("plain", 80, 1.0)]
    found = figures(turns)
    assert found["steps_per_second"] == {"plain": 100.0, "tls": 92.5}
    assert found["cost"] == pytest.approx(0.075)
    assert found["cost_of_pairs"]["least"] == pytest.approx(1.0 - 95.0 / 80.0)
    assert found["cost_of_pairs"]["most"] == pytest.approx(0.1)
    assert found["cost_of_pairs"]["median"] == pytest.approx(0.075)
    assert (found["pairs"], found["seconds"]) == (4, {"plain": 5.0, "tls": 3.0})


def test_a_turn_does_not_count_the_time_of_standing_still(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [1000.0]
    monkeypatch.setattr("lndrl.bench.tls.time.time", lambda: clock[0])
    plain = Script(clock, 100, 4.0)
    slow = Script(clock, 100, 5.0)
    scripts = {"plain": plain, "tls": slow}
    runs = [Paused(name, cast(Training, script)) for name, script in scripts.items()]
    turns = alternate(runs, 30.0)
    assert [turn.run for turn in turns] == ["plain", "tls", "plain", "tls", "plain", "tls", "plain"]
    assert {turn.rate for turn in turns if turn.run == "plain"} == {25.0}
    assert {turn.rate for turn in turns if turn.run == "tls"} == {20.0}
    assert {turn.seconds for turn in turns} == {12.0, 10.0}
    assert plain.calls == ["pause", *["go on", "pause"] * 4]


def test_two_trainings_take_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = tls._settings()
    monkeypatch.setattr(tls, "_settings", lambda: [*settings, "--set", *SMALL])
    monkeypatch.setattr(tls, "_TURN", 0.5)
    monkeypatch.setattr(training, "_STARTUP", 1800.0)  # s; compiling on a busy machine takes long
    before = descendants(os.getpid())
    found = tls.measure(0.05)
    # The first stands still while the second starts, which outlasts a usual lease.
    assert found["actors_lost"] == 0
    assert found["pairs"] >= 4
    assert min(found["steps_per_second"].values()) > 0
    assert found["cost"] < 1
    assert not any(lives(pid) for pid in descendants(os.getpid()) if pid not in before)
