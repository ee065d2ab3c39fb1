"""What a chaos run says of a learner's memory, from samples made by hand."""

from __future__ import annotations

import pytest

from lndrl.chaos.monitor import LIFE_LEAST, Life, Monitor


def life(*sizes: int, seconds: float = 3600.0) -> Life:
    """One that was looked at once a second, of these sizes (MB) for equally long."""
    made = Life(pid=1, started=0.0)
    each = seconds / len(sizes)
    made.samples = [
        (100.0 + second, sizes[min(len(sizes) - 1, int(second / each))] * 1_000_000, 40)
        for second in range(int(seconds) + 1)
    ]
    return made


def test_growth_is_that_of_the_last_fifth_over_the_first() -> None:
    assert life(500, 600, 700, 600, 510).growth(1) == pytest.approx(0.02)
    assert life(500, 500, 500, 500, 500).growth(2) == 0.0


def test_a_peak_within_a_fifth_is_no_growth() -> None:
    steady = [500] * 25
    steady[22] = 900
    assert life(*steady).growth(1) == 0.0


def test_parts_are_equally_long_even_where_nobody_looked_for_a_while() -> None:
    gap = life(500, 500, 500, 500, 510)
    gap.samples = [row for row in gap.samples if not 200.0 < row[0] < 2900.0]
    assert gap.fifths(1) == [500e6, 500e6, 510e6]
    assert gap.growth(1) == pytest.approx(0.02)


def test_a_short_life_says_nothing() -> None:
    short = life(500, 600, seconds=LIFE_LEAST - 1.0)
    assert short.growth(1) is None
    assert short.fifths(1) == []
    assert Life(1, 0.0).growth(1) is None


def test_memory_is_shown_by_fifth_of_the_longest_life() -> None:
    monitor = Monitor.__new__(Monitor)
    monitor.lives = []
    assert monitor.memory_by_fifth() == []
    assert monitor.memory_growth() is None
    monitor.lives = [life(500, 600, seconds=100.0), life(500, 520, 520, 520, 521), Life(2, 0.0)]
    assert monitor.memory_by_fifth() == [500.0, 520.0, 520.0, 520.0, 521.0]
    assert monitor.memory_growth() == pytest.approx(0.2)
