"""Poses between poses, and an odometer's readings by their stamps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lndrl.localization import OdometryHistory, compose, interpolate, relative

numbers = st.floats(-100.0, 100.0)
angles = st.floats(-3.1, 3.1)
poses = st.tuples(numbers, numbers, angles)


@given(poses, poses)
def test_composing_undoes_looking_from(start: tuple[float, ...], end: tuple[float, ...]) -> None:
    again = compose(start, relative(start, end))
    assert again[:2] == pytest.approx(end[:2], abs=1e-9)
    assert math.cos(again[2] - end[2]) == pytest.approx(1.0)


def test_headings_take_the_shorter_way() -> None:
    middle = interpolate((0.0, 0.0, 3.0), (2.0, 4.0, -3.0), 0.5)
    assert middle[:2] == pytest.approx([1.0, 2.0])
    assert abs(middle[2]) == pytest.approx(math.pi)
    assert interpolate((0.0, 0.0, 0.0), (1.0, 0.0, 0.4), 1.5) == pytest.approx([1.5, 0.0, 0.6])


def history(**settings: float) -> OdometryHistory:
    made = OdometryHistory(**settings)
    for k in range(5):
        assert made.add(10.0 + 0.1 * k, [0.05 * k, 0.0, 0.2 * k])
    return made


def test_a_pose_between_two_readings() -> None:
    read = history()
    assert read.at(10.15) == pytest.approx([0.075, 0.0, 0.3])
    assert read.at(10.0) == pytest.approx([0.0, 0.0, 0.0])
    assert read.at(10.4) == pytest.approx([0.2, 0.0, 0.8])
    # A little ahead it goes on as it went; farther it says nothing.
    assert read.at(10.44) == pytest.approx([0.22, 0.0, 0.88])
    assert read.at(10.46) is None and read.at(9.99) is None and read.at(math.nan) is None


def test_one_reading_says_one_moment() -> None:
    read = OdometryHistory()
    assert read.at(1.0) is None
    assert read.add(1.0, [1.0, 2.0, 3.0])
    assert read.at(1.0) == pytest.approx([1.0, 2.0, 3.0])
    assert read.at(0.9) is None


def test_what_cannot_be_is_not_kept() -> None:
    read = history()
    assert not read.add(10.4, [9.0, 9.0, 0.0])  # the same time twice
    assert not read.add(10.2, [9.0, 9.0, 0.0])  # backward
    assert not read.add(math.nan, [0.0, 0.0, 0.0])
    assert not read.add(11.0, [math.inf, 0.0, 0.0])
    assert len(read) == 5 and read.newest == pytest.approx(10.4)
    with pytest.raises(ValueError, match="x, y, yaw"):
        read.add(12.0, [0.0, 0.0])
    read.clear()
    assert read.add(1.0, [0.0, 0.0, 0.0])  # a clock that began anew


def test_the_past_is_forgotten_but_for_what_is_needed() -> None:
    read = OdometryHistory(keep=1.0)
    for k in range(100):
        read.add(0.1 * k, [0.01 * k, 0.0, 0.0])
    assert 10 <= len(read) <= 13 and read.oldest <= 8.9
    assert read.at(9.05) == pytest.approx([0.905, 0.0, 0.0])
    read.add(50.0, np.zeros(3))
    assert len(read) == 2 and read.at(30.0) is not None  # the two around a gap
