"""What a running episode has gathered so far, as arrays for kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RUNNING, COLLIDED, LOST, ARRIVED, TIMEOUT = range(5)
OUTCOME_NAMES = ("", "collided", "lost", "arrived", "timeout")
"""Names of the numbers that ``Track.outcome`` holds."""


class Track(NamedTuple):
    """One episode; with a leading world dimension on every array, many."""

    scan: NDArray[np.float32]  # (beams,) m, the last full one
    before: Floats  # (3, 3) before the step: true pose, the one heard, the truth it is judged by
    variance: Floats  # (3,) of x, y (m^2), yaw (rad^2), as heard after the step
    reward: Floats  # (1,) of the last step
    parts: Floats  # (6,) its summands
    sums: Floats  # (9,) of parts, position error, angle error, sum of variances
    distance: Floats  # (1,) m along the true path
    steps: NDArray[np.int64]  # (1,)
    outcome: NDArray[np.int64]  # (1,) see above
    reports: Floats  # (delay + 1, 9) pose, variances, truth; newest first, the last is heard
    path: Floats  # (steps_limit + 1, 2) true positions
    path_estimated: Floats  # (steps_limit + 1, 2)


def make_tracks(worlds: int, beams: int, steps_limit: int, delay: int = 0) -> Track:
    """Tracks of ``worlds`` worlds, all zero: every array has a leading world dimension.

    The robot hears what its filter said ``delay`` control steps ago.
    """
    return Track(
        scan=np.zeros((worlds, beams), np.float32),
        before=np.zeros((worlds, 3, 3)),
        variance=np.zeros((worlds, 3)),
        reward=np.zeros((worlds, 1)),
        parts=np.zeros((worlds, 6)),
        sums=np.zeros((worlds, 9)),
        distance=np.zeros((worlds, 1)),
        steps=np.zeros((worlds, 1), np.int64),
        outcome=np.zeros((worlds, 1), np.int64),
        reports=np.zeros((worlds, delay + 1, 9)),
        path=np.zeros((worlds, steps_limit + 1, 2)),
        path_estimated=np.zeros((worlds, steps_limit + 1, 2)),
    )


def track_of(tracks: Track, world: int) -> Track:
    """Views of one world's arrays in ``make_tracks``."""
    return Track(*(array[world] for array in tracks))
