"""A scanner on a robot: where it sits, which way up, between which ranges it sees."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Ranges = NDArray[np.float32]


@dataclass(frozen=True)
class Scanner:
    """Pose of a planar scanner on the base, and its limits.

    ``x``, ``y`` (m) and ``yaw`` (rad): where it stands and where its zero bearing points, in the
    base's frame (REP-103: x forward, y left). ``upside_down``: mounted with its axis down, so that
    its bearings run clockwise as seen from above. Readings at or below ``range_min`` and at or
    beyond ``range_max`` (m) are no echo; a negative ``range_min`` means that it has none.
    Raises ValueError for numbers that are not finite, and for a ``range_max`` that is not above
    ``range_min`` and 0.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    upside_down: bool = False
    range_min: float = -1.0
    range_max: float = 12.0

    def __post_init__(self) -> None:
        numbers = (self.x, self.y, self.yaw, self.range_min, self.range_max)
        if not all(math.isfinite(number) for number in numbers):
            raise ValueError(f"a scanner's pose and ranges must be finite: {self}")
        if self.range_max <= max(self.range_min, 0.0):
            raise ValueError(
                f"range_max {self.range_max:g} m must be above range_min {self.range_min:g} m and 0"
            )

    def bearings(self, angle_min: float, angle_increment: float, count: int) -> Ranges:
        """Directions ``(count,)`` (rad) of the beams in the base's frame, in their order.

        ``angle_min`` and ``angle_increment`` (rad) are those of the scanner's own frame
        (sensor_msgs/LaserScan).
        """
        own = angle_min + angle_increment * np.arange(count, dtype=np.float64)
        return (self.yaw - own if self.upside_down else self.yaw + own).astype(np.float32)

    def echoes(self, ranges: NDArray[np.floating], farthest: float | None = None) -> Ranges:
        """``ranges`` (m) with whatever is no echo as ``range_max``, single precision, a copy.

        ``+inf`` is no echo (REP-117), nor is a reading at or beyond ``farthest``, where the message
        names a smaller maximum of its own. NaN, which says that something is wrong, stays.
        """
        found = np.array(ranges, dtype=np.float32)
        limit = self.range_max if farthest is None else min(self.range_max, farthest)
        # Comparisons with NaN are false. As in the filter, limits are single precision too.
        near, far = np.float32(self.range_min), np.float32(limit)
        with np.errstate(invalid="ignore"):
            found[(found <= near) | (found >= far)] = np.float32(self.range_max)
        return found


AT_THE_CENTRE = Scanner()
"""The simulated laser: at the robot's centre, level, without a minimum range."""
