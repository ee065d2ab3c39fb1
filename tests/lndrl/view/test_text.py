from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lndrl.view.text import (
    SPARKS,
    duration,
    number,
    percent,
    progress_bar,
    resample,
    sparkline,
    stacked_bar,
    wrap,
)

NUMBERS = st.lists(st.none() | st.floats(-1e6, 1e6) | st.just(math.nan), max_size=300)


def test_sparkline_spans_lowest_to_highest() -> None:
    assert sparkline([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], 8) == SPARKS
    assert sparkline([3.0, 3.0, 3.0], 8) == SPARKS[0] * 3
    assert sparkline([0.0, None, 1.0], 8) == f"{SPARKS[0]} {SPARKS[-1]}"
    assert sparkline([], 8) == sparkline([None], 8) == sparkline([1.0], 0) == ""


def test_sparkline_averages_what_it_has_no_room_for() -> None:
    assert resample([0.0, 2.0, 10.0, 30.0], 2) == [1.0, 20.0]
    assert resample([None, None, 1.0, None], 2) == [None, 1.0]
    assert sparkline([*[0.0] * 50, *[1.0] * 50], 4) == SPARKS[0] * 2 + SPARKS[-1] * 2


@given(NUMBERS, st.integers(1, 90))
def test_sparkline_fits(values: list[float | None], width: int) -> None:
    line = sparkline(values, width)
    assert len(line) <= width
    assert set(line) <= set(SPARKS) | {" "}


@given(st.lists(st.floats(0, 1), max_size=5), st.integers(0, 80))
def test_bars_have_their_width(shares: list[float], width: int) -> None:
    assert len(stacked_bar([(share, "red") for share in shares], width).plain) == width
    assert len(progress_bar(sum(shares), width, "red").plain) == width


def test_stacked_bar_is_proportional() -> None:
    assert stacked_bar([(0.5, "red"), (0.25, "blue")], 8).plain == "████▓▓··"
    assert progress_bar(0.5, 5, "red").plain == "━━╸──"


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (None, "–"),
        (math.inf, "–"),
        (0.4, "0 s"),
        (59.6, "1 min"),
        (185, "3 min 5 s"),
        (1531, "25 min"),
        (7800, "2 h 10 min"),
        (7200, "2 h"),
        (273600, "3 d 4 h"),
    ],
)
def test_duration(seconds: float | None, words: str) -> None:
    assert duration(seconds) == words


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (None, "–"),
        (math.nan, "NaN"),
        (-math.inf, "-inf"),
        (0.0, "0"),
        (0.0081, "0.00810"),
        (0.00027, "2.7e-04"),
        (81.04, "81.0"),
        (-0.0123, "-0.0123"),
        (12345.6, "12,346"),
    ],
)
def test_number(value: float | None, words: str) -> None:
    assert number(value) == words


def test_percent() -> None:
    assert (percent(0.521), percent(1.0, 0), percent(None)) == ("52.1 %", "100 %", "–")


def test_wrap() -> None:
    assert wrap("one two three four", 8, 2) == ["one two", "three four"]
    assert wrap("one\ntwo", 80, 2) == ["one two"]
