"""Hazards and their intervals by hand and by simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lndrl.evaluation.hazard import Hazard, hazard_ratio
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.reward import REWARD_PARTS


def record(outcome: str, steps: int) -> EpisodeRecord:
    parts = dict.fromkeys(REWARD_PARTS, 0.0)
    return EpisodeRecord(0, 0, outcome, steps, 0.4 * steps, 1.0, 0.0, 0.0, 0.0, 0.0, parts)  # type: ignore[arg-type]


def test_a_hazard_counts_all_steps_and_the_lost_alone() -> None:
    records = [record("lost", 30), record("arrived", 60), record("collided", 10)]
    assert Hazard.of(records) == Hazard(1, 100)
    assert Hazard.of(records).value == 10.0
    assert Hazard(0, 0).value == 0.0 and Hazard(0, 0).interval == (0.0, math.inf)


def test_none_lost_is_an_upper_limit_too() -> None:
    assert Hazard(0, 1000).interval == pytest.approx((0.0, 3.69), abs=0.01)
    assert Hazard(10, 2000).interval == pytest.approx((2.40, 9.20), abs=0.01)


def test_a_ratio_divides_hazards_not_counts() -> None:
    value, (low, high) = hazard_ratio(Hazard(10, 1000), Hazard(20, 4000))
    assert value == pytest.approx(2.0) and 0 < low < 2.0 < high
    assert hazard_ratio(Hazard(3, 100), Hazard(0, 100))[0] is None
    value, interval = hazard_ratio(Hazard(0, 100), Hazard(5, 100))
    assert value == 0.0 and interval == pytest.approx((0.0, 1.09), abs=0.01)


def test_the_ratios_interval_holds_what_it_promises() -> None:
    random = np.random.default_rng(1)
    inside = 0
    for first, second in zip(random.poisson(6, 800), random.poisson(24, 800), strict=True):
        _, (low, high) = hazard_ratio(Hazard(int(first), 1000), Hazard(int(second), 2000))
        inside += low <= 0.5 <= high
    assert inside >= 0.94 * 800  # exact, so conservative: 0.95 or more, and 0.94 with the noise
