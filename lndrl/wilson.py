"""Confidence intervals of rates: Wilson's score interval."""

from __future__ import annotations

import math

NORMAL_QUANTILE_95 = 1.959963984540054
"""97.5 % quantile of the standard normal: two-sided 95 %."""


def wilson_interval(
    successes: int, trials: int, quantile: float = NORMAL_QUANTILE_95
) -> tuple[float, float]:
    """Interval ``(low, high)`` in [0, 1] for the rate ``successes / trials``.

    Unlike the normal approximation it stays inside [0, 1] and has a width at rates of 0 and 1,
    which the lost and stuck rates of a good planner reach. Without trials nothing is known:
    ``(0.0, 1.0)``.

    Raises ValueError unless ``0 <= successes <= trials``.

    Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference",
    JASA 22 (1927).
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials are impossible")
    if trials == 0:
        return 0.0, 1.0
    rate = successes / trials
    square = quantile * quantile / trials
    centre = (rate + 0.5 * square) / (1.0 + square)
    half = quantile * math.sqrt(rate * (1.0 - rate) / trials + 0.25 * square / trials)
    half /= 1.0 + square
    # At the ends the bound is exact; rounding would leave 1e-17 or 0.9999999999999999.
    low = 0.0 if successes == 0 else max(0.0, centre - half)
    high = 1.0 if successes == trials else min(1.0, centre + half)
    return low, high
