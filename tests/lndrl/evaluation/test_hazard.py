from __future__ import annotations

import pytest

from lndrl.evaluation.hazard import Hazard
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.reward import REWARD_PARTS


def record(outcome: str, steps: int) -> EpisodeRecord:
    parts = dict.fromkeys(REWARD_PARTS, 0.0)
    return EpisodeRecord(0, 0, outcome, steps, 1.0, 1.0, 0.1, 0.1, 0.1, 0.0, parts)  # type: ignore[arg-type]


def test_it_is_per_thousand_steps_of_all_episodes() -> None:
    hazard = Hazard.of([record("lost", 40), record("collided", 10), record("arrived", 150)])
    assert (hazard.count, hazard.steps) == (1, 200)
    assert hazard.value == pytest.approx(5.0)
    low, high = hazard.interval
    assert 0.0 < low < 5.0 < high < 1000.0
    # Who collides early has driven fewer steps in which to get lost.
    early = Hazard.of([record("lost", 40), record("collided", 10)])
    assert early.value > hazard.value


def test_with_few_losses_the_interval_is_that_of_counts() -> None:
    """Exact Poisson limits of 10 counts are 4.80 and 18.39."""
    low, high = Hazard(10, 10_000).interval
    assert low == pytest.approx(0.480, rel=0.15)
    assert high == pytest.approx(1.839, rel=0.05)


def test_without_steps_nothing_is_known() -> None:
    assert Hazard.of([]).value == 0.0
    assert Hazard.of([]).interval == (0.0, 1000.0)
