"""Frames of a robot: what transforms say of where one is in another."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lndrl.localization import Scanner
from lndrl.robot.messages import Transforms

Floats = NDArray[np.float64]

_MOST_FRAMES = 1000
_DEEPEST = 50


class Frames:
    """The newest transform of each child; fixed and moving ones alike."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Floats]] = {}

    def add(self, transforms: Transforms) -> None:
        """Take in a message; transforms that are not finite are left out."""
        for each in transforms.transforms:
            known = each.child in self._parents or len(self._parents) < _MOST_FRAMES
            finite = np.isfinite(each.rotation).all() and np.isfinite(each.translation).all()
            if known and finite and each.child != each.parent:
                matrix = np.eye(4)
                matrix[:3, :3], matrix[:3, 3] = each.rotation, each.translation
                self._parents[each.child] = (each.parent, matrix)

    def find(self, target: str, source: str) -> Floats | None:
        """The matrix (4, 4) that takes points of ``source`` to ``target``; None where unknown."""
        up, down = self._to_root(source), self._to_root(target)
        for frame, matrix in up.items():
            if frame in down:
                return np.linalg.solve(down[frame], matrix).astype(np.float64)
        return None

    def _to_root(self, frame: str) -> dict[str, Floats]:
        """Of ``frame`` and all above it: the matrix from ``frame`` to each."""
        matrix: Floats = np.eye(4)
        found = {frame: matrix}
        for _ in range(_DEEPEST):
            if frame not in self._parents:
                break
            parent, step = self._parents[frame]
            if parent in found:
                break  # a circle
            matrix = step @ matrix
            frame = parent
            found[frame] = matrix
        return found


def planar(matrix: Floats) -> Floats:
    """Pose (3,) of a matrix (4, 4), seen from above."""
    yaw = math.atan2(matrix[1, 0], matrix[0, 0])
    return np.array([matrix[0, 3], matrix[1, 3], yaw])


def mounted(matrix: Floats) -> Scanner:
    """How a scanner stands whose matrix (4, 4) takes its points to the base's, seen from above.

    Its ranges are those of any scanner.
    """
    x, y, yaw = planar(matrix).tolist()
    return Scanner(x, y, yaw, upside_down=bool(matrix[2, 2] < 0.0))
