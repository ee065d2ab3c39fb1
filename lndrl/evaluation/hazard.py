"""How often one gets lost per control step: unlike a rate of episodes, it forgives nobody who
collides early."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy.stats import beta

from lndrl.evaluation.poisson import poisson_interval
from lndrl.navigation import EpisodeRecord

STEPS = 1000
"""A hazard is per so many control steps."""
_TAIL = 0.025  # on either side: 95 %


@dataclass(frozen=True)
class Hazard:
    """``count`` episodes ended lost in ``steps`` control steps."""

    count: int
    steps: int

    @classmethod
    def of(cls, records: Sequence[EpisodeRecord]) -> Hazard:
        """Over all steps of ``records``."""
        lost = sum(record.outcome == "lost" for record in records)
        return cls(lost, sum(record.steps for record in records))

    @property
    def value(self) -> float:
        """Lost per 1,000 control steps; 0 without steps."""
        return STEPS * self.count / self.steps if self.steps else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Exact Poisson 95 % interval ``(low, high)``; of no steps nothing is known."""
        if not self.steps:
            return 0.0, math.inf
        low, high = poisson_interval(self.count)
        return STEPS * low / self.steps, STEPS * high / self.steps


def hazard_ratio(first: Hazard, second: Hazard) -> tuple[float | None, tuple[float, float]]:
    """``first`` over ``second`` with its 95 % interval; None where ``second`` lost nobody.

    Given how many both lost together, how many of them the first lost is binomial, so the interval
    is exact (Clopper and Pearson 1934).
    """
    if not (first.steps and second.steps):
        return None, (0.0, math.inf)
    exposure = second.steps / first.steps
    low, high = _share_interval(first.count, first.count + second.count)
    interval = (
        exposure * low / (1 - low) if low < 1 else math.inf,
        exposure * high / (1 - high) if high < 1 else math.inf,
    )
    return (exposure * first.count / second.count if second.count else None), interval


def _share_interval(successes: int, trials: int) -> tuple[float, float]:
    low = float(beta.ppf(_TAIL, successes, trials - successes + 1)) if successes else 0.0
    high = (
        float(beta.ppf(1 - _TAIL, successes + 1, trials - successes)) if successes < trials else 1.0
    )
    return low, high
