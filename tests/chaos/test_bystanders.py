"""How others fare while one is frozen, from arrivals made by hand."""

from __future__ import annotations

from typing import cast

import pytest

from lndrl.chaos import bystanders
from lndrl.chaos.bystanders import AFTER, Bystanders
from lndrl.chaos.monitor import Monitor


class Clock:
    now = 1000.0

    def monotonic(self) -> float:
        return self.now


class Seen:
    """A monitor of actors ``a`` (pid 1) and ``b`` (pid 2), which deliver at given rates."""

    def __init__(self) -> None:
        self.arrivals: list[tuple[float, str, int]] = []

    def look(self) -> None:
        pass

    def name_of(self, pid: int) -> str | None:
        return {1: "a", 2: "b"}.get(pid)

    def arrived(self, actors, begin: float, end: float) -> int:
        return sum(n for at, name, n in self.arrivals if begin < at <= end and name in actors)

    def bystanders(self) -> Bystanders:
        return Bystanders(cast(Monitor, self))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(bystanders, "time", clock)
    return clock


def run(clock: Clock, seen: Seen, seconds: int, a: int, b: int) -> None:
    """Let time pass; so many samples per second of each."""
    for _ in range(seconds):
        clock.now += 1.0
        seen.arrivals += [(clock.now, "a", a), (clock.now, "b", b), (clock.now, "rogue", 99)]


def test_others_are_held_against_the_time_before(clock: Clock) -> None:
    seen = Seen()
    others = seen.bystanders()
    run(clock, seen, 20, a=7, b=1)
    run(clock, seen, 10, a=7, b=10)
    others.frozen("actor-0", [2, 3])
    run(clock, seen, 10, a=0, b=12)
    assert others.thawed("actor-0") == pytest.approx(1.2)
    assert others.thawed("actor-0") is None, "it was not frozen any more"


@pytest.mark.parametrize(
    ("at", "seconds", "counts"),
    [(4, 2.0, True), (4, 7.0, False), (12, 0.0, False), (25, 3.0, False), (25, 40.0, False)],
)
def test_other_faults_spoil_a_pair(clock: Clock, at: int, seconds: float, counts: bool) -> None:
    seen = Seen()
    others = seen.bystanders()
    for moment in range(30):
        if moment == at:
            others.disturbed(clock.now, seconds)
        if moment == 20:
            others.frozen("actor-0", [2])
        run(clock, seen, 1, a=7, b=10)
    assert (others.thawed("actor-0") is not None) == counts


def test_other_freezes_spoil_a_pair_too(clock: Clock) -> None:
    seen = Seen()
    others = seen.bystanders()
    run(clock, seen, 20, a=7, b=10)
    others.frozen("actor-0", [2])
    run(clock, seen, 5, a=0, b=10)
    others.frozen("actor-1", [1])
    run(clock, seen, 5, a=0, b=0)
    assert others.thawed("actor-0") is None, "the other stands still, too"
    run(clock, seen, 5, a=7, b=0)
    assert others.thawed("actor-1") is None, "the other stood still, too"
    run(clock, seen, int(AFTER) + 10, a=7, b=10)
    others.frozen("actor-1", [1])
    run(clock, seen, 10, a=7, b=0)
    assert others.thawed("actor-1") == pytest.approx(1.0)


def test_nobody_else_or_no_time_is_no_figure(clock: Clock) -> None:
    seen = Seen()
    others = seen.bystanders()
    run(clock, seen, 20, a=7, b=10)
    others.frozen("actor-0", [])
    run(clock, seen, 10, a=7, b=10)
    assert others.thawed("actor-0") is None
    run(clock, seen, 20, a=7, b=10)
    others.frozen("actor-0", [2])
    run(clock, seen, 2, a=7, b=10)
    assert others.thawed("actor-0") is None
