"""Where the odometer stood at the time of a scan: readings kept by their stamps, interpolated.

A scan's stamp lies between two odometer readings; at 0.9 rad/s a tenth of a second is 5 degrees.
ROS lets tf interpolate; this is the same, without tf.
"""

from __future__ import annotations

import bisect
import math
from collections import deque

import numpy as np
from numpy.typing import ArrayLike

from lndrl.localization.belief import Vector


def interpolate(before: ArrayLike, after: ArrayLike, share: float) -> Vector:
    """The pose ``share`` of the way from ``before`` to ``after`` (x, y, yaw; m, rad).

    Headings take the shorter way round. A share beyond 1 goes on as the two say.
    """
    a, b = np.array(before, dtype=np.float64), np.array(after, dtype=np.float64)
    pose = a + share * (b - a)
    pose[2] = math.remainder(a[2] + share * math.remainder(b[2] - a[2], math.tau), math.tau)
    return pose


def compose(pose: ArrayLike, move: ArrayLike) -> Vector:
    """Where ``move``, as seen from ``pose``, leads (x, y, yaw; m, rad)."""
    x, y, yaw = (float(v) for v in np.asarray(pose))
    dx, dy, turn = (float(v) for v in np.asarray(move))
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array(
        [x + c * dx - s * dy, y + s * dx + c * dy, math.remainder(yaw + turn, math.tau)]
    )


def relative(start: ArrayLike, end: ArrayLike) -> Vector:
    """``end`` as seen from ``start`` (x, y, yaw; m, rad): what ``compose`` undoes."""
    x0, y0, yaw0 = (float(v) for v in np.asarray(start))
    x1, y1, yaw1 = (float(v) for v in np.asarray(end))
    c, s = math.cos(yaw0), math.sin(yaw0)
    dx, dy = x1 - x0, y1 - y0
    return np.array([c * dx + s * dy, c * dy - s * dx, math.remainder(yaw1 - yaw0, math.tau)])


class OdometryHistory:
    """The last readings of an odometer by their stamps (s).

    ``keep`` (s): how far back it remembers. ``ahead`` (s): how far beyond the newest reading it
    goes on as the last two say; a stamp farther ahead waits for more readings.
    """

    def __init__(self, keep: float = 5.0, ahead: float = 0.05) -> None:
        self._keep, self._ahead = keep, ahead
        self._stamps: deque[float] = deque()
        self._poses: deque[Vector] = deque()

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def newest(self) -> float:
        """Stamp of the newest reading (s); minus infinity without one."""
        return self._stamps[-1] if self._stamps else -math.inf

    @property
    def oldest(self) -> float:
        """Stamp of the oldest reading that is kept (s); infinity without one."""
        return self._stamps[0] if self._stamps else math.inf

    def add(self, stamp: float, pose: ArrayLike) -> bool:
        """Take a reading; False, and nothing kept, if it is not finite or not newer than the last.

        Raises ValueError for another shape than (3,).
        """
        reading = np.array(pose, dtype=np.float64)
        if reading.shape != (3,):
            raise ValueError(f"an odometer's pose is x, y, yaw, not {pose!r}")
        if not (math.isfinite(stamp) and np.isfinite(reading).all() and stamp > self.newest):
            return False
        self._stamps.append(stamp)
        self._poses.append(reading)
        # Two stay whatever their age, for what lies between them.
        while len(self._stamps) > 2 and self._stamps[1] < stamp - self._keep:
            self._stamps.popleft()
            self._poses.popleft()
        return True

    def clear(self) -> None:
        """Forget all readings, for a clock or an odometer that began anew."""
        self._stamps.clear()
        self._poses.clear()

    def at(self, stamp: float) -> Vector | None:
        """The odometer's pose (3,) at ``stamp`` (s); None where no reading says it."""
        if not self._stamps or not self.oldest <= stamp <= self.newest + self._ahead:
            return None
        if len(self._stamps) == 1 or stamp == self.newest:
            return self._poses[-1].copy()
        after = min(bisect.bisect_right(self._stamps, stamp), len(self._stamps) - 1)
        early, late = self._stamps[after - 1], self._stamps[after]
        share = (stamp - early) / (late - early)
        return interpolate(self._poses[after - 1], self._poses[after], share)
