"""Two methods over the same episodes: by how much they differ, and whether by chance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from lndrl.evaluation.benchmark.figures import Row, mcnemar
from lndrl.wilson import wilson_interval


@dataclass(frozen=True)
class Difference:
    """How many of the episodes that two methods have driven ended in one way for whom.

    ``p`` is McNemar's exact two-sided probability of such a difference by chance.
    """

    both: int
    only_first: int
    only_second: int
    neither: int
    p: float

    @classmethod
    def of(cls, first: Row, second: Row, outcome: str) -> Difference:
        """Of ``outcome`` between ``first`` and ``second``, in the episodes that both have."""
        shared = first.records.keys() & second.records.keys()
        paired = mcnemar(first, second, outcome)
        ended = sum(second.records[key].outcome == outcome for key in shared)
        both = ended - paired.only_second
        discordant = paired.only_first + paired.only_second
        neither = len(shared) - both - discordant
        return cls(both, paired.only_first, paired.only_second, neither, paired.p)

    @property
    def episodes(self) -> int:
        """That both have driven."""
        return self.both + self.only_first + self.only_second + self.neither

    @property
    def value(self) -> float:
        """Rate of the first less that of the second, -1 to 1; 0 without episodes."""
        return (self.only_first - self.only_second) / self.episodes if self.episodes else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Paired 95 % interval ``(low, high)`` of ``value``."""
        return paired_interval(self.both, self.only_first, self.only_second, self.neither)

    def to_dict(self) -> dict[str, Any]:
        """Plain types; rates, not points."""
        return {
            "difference": self.value,
            "interval": list(self.interval),
            "p": self.p,
            "discordant": self.only_first + self.only_second,
            "only_first": self.only_first,
            "only_second": self.only_second,
        }


def paired_interval(
    both: int, only_first: int, only_second: int, neither: int
) -> tuple[float, float]:
    """95 % interval ``(low, high)`` of the difference of two rates over the same trials.

    Counts are those of trials in which both, one or neither succeeded. Made of the two Wilson
    intervals, so it has a width where nobody differs and stays within -1 and 1. Without trials
    nothing is known: ``(-1.0, 1.0)``. Raises ValueError for negative counts.

    Source: R. G. Newcombe, "Improved confidence intervals for the difference between binomial
    proportions based on paired data", Statistics in Medicine 17 (1998), method 10.
    """
    if min(both, only_first, only_second, neither) < 0:
        raise ValueError("numbers of trials cannot be negative")
    n = both + only_first + only_second + neither
    if n == 0:
        return -1.0, 1.0
    first, second = both + only_first, both + only_second
    (low_1, high_1), (low_2, high_2) = wilson_interval(first, n), wilson_interval(second, n)
    p_1, p_2 = first / n, second / n
    phi = _correlation(both, only_first, only_second, neither)
    below, above = p_1 - low_1, high_2 - p_2
    low = p_1 - p_2 - math.sqrt(below**2 - 2 * phi * below * above + above**2)
    below, above = p_2 - low_2, high_1 - p_1
    high = p_1 - p_2 + math.sqrt(below**2 - 2 * phi * below * above + above**2)
    return max(-1.0, low), min(1.0, high)


def _correlation(both: int, only_first: int, only_second: int, neither: int) -> float:
    """Of the two successes; where positive with Newcombe's correction for continuity."""
    n = both + only_first + only_second + neither
    margins = (
        (both + only_first)
        * (only_second + neither)
        * (both + only_second)
        * (only_first + neither)
    )
    if margins == 0:
        return 0.0
    excess = both * neither - only_first * only_second
    corrected = max(excess - n / 2, 0.0) if excess > 0 else float(excess)
    return corrected / math.sqrt(margins)
