"""Confidence intervals of counts of rare events: the exact interval of a Poisson count."""

from __future__ import annotations

from scipy.special import gammaincinv


def poisson_interval(events: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval ``(low, high)`` for the expected number of events of which ``events`` were counted.

    Divided by the exposure it is the interval of a hazard; with no event it begins at 0 and ends
    at 3.7, so "none in 1,000 steps" means below 3.7 per 1,000. Raises ValueError below 0.

    Source: F. Garwood, "Fiducial limits for the Poisson distribution", Biometrika 28 (1936).
    """
    if events < 0:
        raise ValueError(f"{events} events cannot have been counted")
    tail = 0.5 * (1.0 - confidence)
    low = float(gammaincinv(events, tail)) if events else 0.0
    return low, float(gammaincinv(events + 1, 1.0 - tail))
