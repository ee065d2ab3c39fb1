"""What of an episode changes over time, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.navigation import WorldSnapshot

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Course:
    """An episode of K moments: its start and the end of each control step.

    ``position_error`` (m) and ``angle_error`` (rad) are those that being lost is judged by.
    """

    time: Floats  # (K,) s
    position_error: Floats  # (K,)
    angle_error: Floats  # (K,)
    part_names: tuple[str, ...]
    paid: Floats  # (K, parts) sums since the start
    lost_at: float | None
    """s at which it got lost."""


def course_of(snapshots: Sequence[WorldSnapshot]) -> Course:
    """The course of one episode, of which there must be a moment."""
    last = snapshots[-1]
    parts = np.array([s.parts for s in snapshots], dtype=np.float64)
    return Course(
        time=np.array([s.time for s in snapshots]),
        position_error=np.array([s.position_error for s in snapshots]),
        angle_error=np.array([s.angle_error for s in snapshots]),
        part_names=last.part_names,
        paid=parts.cumsum(axis=0),
        lost_at=last.time if last.outcome == "lost" else None,
    )


def deviation_ellipse(covariance: Floats, deviations: float = 2.0) -> tuple[float, float, float]:
    """Half axes (m), the longer first, and direction (rad) of the longer of the ellipse at so many
    standard deviations of x and y; of a (3, 3) covariance of x, y, yaw.
    """
    values, vectors = np.linalg.eigh(np.asarray(covariance, dtype=np.float64)[:2, :2])
    long, short = np.sqrt(values.clip(0.0))[::-1] * deviations
    return float(long), float(short), float(np.arctan2(vectors[1, 1], vectors[0, 1]))
