"""What the wheels have said lately: a pose at any moment of it, and whether it can be true."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from lndrl.robot.driving.reasons import Reason
from lndrl.robot.geometry import interpolated, wrapped
from lndrl.robot.messages import SECOND, Odometry

Floats = NDArray[np.float64]

_KEPT = 4.0
"""s of readings that are kept: no scan is later than that."""
_JUMP = (0.2, 2.0)
"""m, and m/s beyond which nothing here drives."""
_TURN = (0.4, 5.0)
"""rad, and rad/s."""
_AHEAD = 0.15
"""s by which a scan may be ahead of the newest reading: it is taken to go on as it did."""


class Wheels:
    """The readings of the last seconds, by stamp."""

    def __init__(self) -> None:
        self._readings: deque[tuple[int, Floats]] = deque()
        self.velocity: Floats = np.zeros(2)
        self.frame = ""
        self.child = ""

    @property
    def newest(self) -> Floats | None:
        """(3,) the last pose."""
        return self._readings[-1][1] if self._readings else None

    @property
    def stamp(self) -> int | None:
        """ns of the last reading."""
        return self._readings[-1][0] if self._readings else None

    def clear(self) -> None:
        """Forget all, as after a jump of the clock."""
        self._readings.clear()

    def add(self, reading: Odometry) -> tuple[Reason, str] | None:
        """Take in a reading; says what is wrong with it. One that comes too late is left out."""
        pose = reading.pose
        if not (np.isfinite(pose).all() and np.isfinite(reading.velocity).all()):
            return Reason.ODOMETRY_INVALID, "the odometry has a pose or speed that is not finite"
        if np.abs(pose[:2]).max() > 1e6:
            return Reason.ODOMETRY_INVALID, "the odometry is more than 1,000 km from its start"
        jumped = None
        if self._readings:
            stamp, last = self._readings[-1]
            if reading.stamp <= stamp:
                return None
            jumped = _jump(last, pose, (reading.stamp - stamp) / SECOND)
        if jumped is not None:
            self._readings.clear()
        self.frame, self.child, self.velocity = reading.frame, reading.child, reading.velocity
        self._readings.append((reading.stamp, pose))
        while self._readings[-1][0] - self._readings[0][0] > _KEPT * SECOND:
            self._readings.popleft()
        return jumped

    def at(self, stamp: int) -> Floats | None:
        """The pose (3,) at ``stamp``, between two readings; None where there is none near."""
        if not self._readings:
            return None
        newest, pose = self._readings[-1]
        if stamp >= newest:
            if stamp - newest > _AHEAD * SECOND:
                return None
            if len(self._readings) < 2:
                return pose
            before, last = self._readings[-2]
            share = (stamp - before) / max(newest - before, 1)
            # Beyond the newest reading by as much as lies between two, at most.
            return interpolated(last, pose, min(share, 2.0))
        later = (newest, pose)
        for earlier in reversed(self._readings):
            if earlier[0] <= stamp:
                share = (stamp - earlier[0]) / max(later[0] - earlier[0], 1)
                return interpolated(earlier[1], later[1], share)
            later = earlier
        return later[1] if later[0] - stamp < _AHEAD * SECOND else None


def _jump(last: Floats, pose: Floats, seconds: float) -> tuple[Reason, str] | None:
    distance = float(np.hypot(*(pose - last)[:2]))
    turn = abs(wrapped(float(pose[2] - last[2])))
    if distance > _JUMP[0] + _JUMP[1] * seconds:
        return Reason.ODOMETRY_JUMPED, f"the odometry jumped by {distance:.1f} m in {seconds:.2f} s"
    if turn > _TURN[0] + _TURN[1] * seconds:
        degrees = np.degrees(turn)
        return Reason.ODOMETRY_JUMPED, f"the odometry turned by {degrees:.0f}° in {seconds:.2f} s"
    return None
