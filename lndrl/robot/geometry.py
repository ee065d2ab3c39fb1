"""Planar poses [x, y, yaw] (m, rad): chained, inverted, and between two moments."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def wrapped(angle: float) -> float:
    """``angle`` (rad) in [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def chained(first: Floats, second: Floats) -> Floats:
    """Where ``second``, given in the frame of ``first``, is in the frame of that."""
    c, s = math.cos(first[2]), math.sin(first[2])
    return np.array(
        [
            first[0] + c * second[0] - s * second[1],
            first[1] + s * second[0] + c * second[1],
            wrapped(float(first[2] + second[2])),
        ]
    )


def inverse(pose: Floats) -> Floats:
    """Where the frame that ``pose`` is given in lies, seen from ``pose``."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array([-c * pose[0] - s * pose[1], s * pose[0] - c * pose[1], wrapped(-pose[2])])


def between(one: Floats, other: Floats) -> Floats:
    """``other`` in the frame of ``one``, both given in one frame."""
    return chained(inverse(one), other)


def interpolated(one: Floats, other: Floats, share: float) -> Floats:
    """The pose at ``share`` of the way from ``one`` to ``other``, turning the shorter way."""
    yaw = one[2] + share * wrapped(float(other[2] - one[2]))
    x, y = one[:2] + share * (other[:2] - one[:2])
    return np.array([x, y, wrapped(float(yaw))])


def moved_points(pose: Floats, points: Floats) -> Floats:
    """``points`` (n, 2), given in the frame of ``pose``, in the frame of that."""
    return turned_vectors(pose, points) + pose[:2]


def turned_vectors(pose: Floats, vectors: Floats) -> Floats:
    """``vectors`` (n, 2), given along the axes of ``pose``, along those of its frame."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.stack(
        [c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]], axis=1
    )


def rotation(yaw: float) -> Floats:
    """The matrix (3, 3) of a turn about z."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
