"""How often something happens per unit of exposure, with exact intervals.

Of two robots that lose their way equally often per episode, the one that collides early is the
worse: it was seldom on the way long enough to get lost. Losses per 1,000 control steps compare them.

Sources: F. Garwood, "Fiducial limits for the Poisson distribution", Biometrika 28 (1936), for one
rate; for the ratio of two, given their sum one count is binomial: Clopper and Pearson, "The use of
confidence or fiducial limits", Biometrika 26 (1934).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy.stats import beta, chi2

from lndrl.navigation import EpisodeRecord

PER = 1000
"""Control steps that a hazard is given per."""
_TAIL = 0.025  # on either side: 95 %


@dataclass(frozen=True)
class Hazard:
    """``count`` events in ``steps`` control steps."""

    count: int
    steps: int

    @classmethod
    def of(cls, records: Sequence[EpisodeRecord]) -> Hazard:
        """Of getting lost, over all control steps of ``records``."""
        lost = sum(record.outcome == "lost" for record in records)
        return cls(lost, sum(record.steps for record in records))

    @property
    def value(self) -> float:
        """Events per ``PER`` control steps; 0 without any step."""
        return PER * self.count / self.steps if self.steps else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Garwood's 95 % interval of ``value``; nothing is known without steps."""
        if not self.steps:
            return 0.0, math.inf
        low = float(chi2.ppf(_TAIL, 2 * self.count)) / 2 if self.count else 0.0
        high = float(chi2.ppf(1 - _TAIL, 2 * self.count + 2)) / 2
        return PER * low / self.steps, PER * high / self.steps


def hazard_ratio(first: Hazard, second: Hazard) -> tuple[float | None, tuple[float, float]]:
    """``first`` over ``second`` and its 95 % interval; None where ``second`` has no event.

    The interval is exact where the counts are Poisson.
    """
    if not (first.steps and second.steps):
        return None, (0.0, math.inf)
    exposure = second.steps / first.steps
    low, high = _share_interval(first.count, first.count + second.count)
    interval = (
        exposure * low / (1 - low) if low < 1 else math.inf,
        exposure * high / (1 - high) if high < 1 else math.inf,
    )
    value = exposure * first.count / second.count if second.count else None
    return value, interval


def _share_interval(successes: int, trials: int) -> tuple[float, float]:
    low = float(beta.ppf(_TAIL, successes, trials - successes + 1)) if successes else 0.0
    high = (
        float(beta.ppf(1 - _TAIL, successes + 1, trials - successes)) if successes < trials else 1.0
    )
    return low, high
