"""How far two values more of a sample are apart."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.evaluation.estimate import Estimate


@pytest.mark.parametrize("count", [2, 3, 5])
def test_two_more_are_so_far_apart_in_95_of_100_cases(count: int) -> None:
    """5,000 times drawn anew: a share of 0.95 has a standard error of 0.003."""
    draws = np.random.default_rng(7).normal(0.9, 0.01, (5_000, count + 2))
    limits = [Estimate.of(draw[2:].tolist()).apart for draw in draws]
    within = [
        limit is not None and abs(d[0] - d[1]) <= limit
        for d, limit in zip(draws, limits, strict=True)
    ]
    assert np.mean(within) == pytest.approx(0.95, abs=0.012)


def test_of_one_value_it_is_unknown() -> None:
    assert Estimate.of([0.5]).apart is None and Estimate.of([]).apart is None
