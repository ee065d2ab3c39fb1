"""Shares and rates against a clock that the test turns."""

from __future__ import annotations

import pytest

from learner.timing import Rates, TimeSplit


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_shares_of_the_window() -> None:
    clock = Clock()
    split = TimeSplit(("wait", "update", "other"), window=60.0, clock=clock)
    assert split.shares() == {"wait": 0.0, "update": 0.0, "other": 0.0}
    with split.during("wait"):
        clock.now += 10.0
    with split.during("update"):
        clock.now += 30.0
        assert split.shares() == {"wait": 0.25, "update": 0.75, "other": 0.0}
        assert split.shares(window=20.0)["update"] == 1.0
    clock.now += 25.0  # now 65: the first 5 s have left the window
    shares = split.shares()
    assert shares["wait"] == pytest.approx(5.0 / 60.0)
    assert shares["update"] == pytest.approx(30.0 / 60.0)
    assert split.shares(window=50.0)["other"] == pytest.approx(0.5)


def test_totals_leave_no_time_out() -> None:
    clock = Clock()
    split = TimeSplit(("wait", "update", "other"), window=5.0, clock=clock)
    clock.now = 100.0  # before the first activity nothing counts
    for _ in range(3):
        with split.during("wait"):
            clock.now += 10.0
        clock.now += 2.0
        with split.during("update"):
            clock.now += 30.0
    clock.now += 4.0
    assert split.totals() == {"wait": 30.0, "update": 90.0, "other": 10.0}
    assert sum(split.totals().values()) == clock.now - 100.0


def test_rates_over_several_windows() -> None:
    clock = Clock()
    rates = Rates((10, 60), clock)
    for _ in range(20):
        clock.now += 1.0
        rates.add(5)
    assert rates.rate(10.0) == pytest.approx(5.0)
    assert rates.all()["60s"] == pytest.approx(5.0)
    clock.now += 20.0
    assert rates.rate(10.0) == 0.0
