"""What the wheels have said lately: a pose at any moment of it, and whether it can be true."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.localization import OdometryHistory, relative
from lndrl.robot.driving.reasons import Reason
from lndrl.robot.geometry import wrapped
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
_LOOK_BACK = 0.2
"""s over which a speed is measured, where the base says none."""
_STANDS = (0.02, 0.05)
"""m/s and rad/s below which a speed that is measured is none."""


class Wheels:
    """The readings of the last seconds, by stamp; filters share ``history``."""

    def __init__(self) -> None:
        self.history = OdometryHistory(keep=_KEPT, ahead=_AHEAD)
        self._last: tuple[int, Floats] | None = None
        self._said: Floats = np.zeros(2)
        self.frame = ""
        self.child = ""

    @property
    def newest(self) -> Floats | None:
        """(3,) the last pose."""
        return None if self._last is None else self._last[1]

    @property
    def stamp(self) -> int | None:
        """ns of the last reading."""
        return None if self._last is None else self._last[0]

    @property
    def velocity(self) -> Floats:
        """(2,) m/s and rad/s, as the base says; measured where it moves and says that it stands."""
        if self._last is None or self._said.any():
            return self._said
        end = self.history.newest
        start = max(self.history.oldest, end - _LOOK_BACK)
        before = self.history.at(start)
        if before is None or end - start < 0.5 * _LOOK_BACK:
            return self._said
        x, y, turn = relative(before, self._last[1]) / (end - start)
        measured = np.array([np.copysign(np.hypot(x, y), x), turn])
        return measured if (np.abs(measured) > _STANDS).any() else self._said

    def clear(self) -> None:
        """Forget all, as after a jump of the clock."""
        self.history.clear()
        self._last, self._said = None, np.zeros(2)

    def add(self, reading: Odometry) -> tuple[Reason, str] | None:
        """Take in a reading; says what is wrong with it. One that comes too late is left out."""
        pose = reading.pose
        if not (np.isfinite(pose).all() and np.isfinite(reading.velocity).all()):
            return Reason.ODOMETRY_INVALID, "the odometry has a pose or speed that is not finite"
        if np.abs(pose[:2]).max() > 1e6:
            return Reason.ODOMETRY_INVALID, "the odometry is more than 1,000 km from its start"
        jumped = None
        if self._last is not None:
            stamp, last = self._last
            if reading.stamp <= stamp:
                return None
            jumped = _jump(last, pose, (reading.stamp - stamp) / SECOND)
        if jumped is not None:
            self.history.clear()
        self.frame, self.child, self._said = reading.frame, reading.child, reading.velocity
        self._last = reading.stamp, pose
        self.history.add(reading.stamp / SECOND, pose)
        return jumped

    def at(self, stamp: int) -> Floats | None:
        """The pose (3,) at ``stamp``, between two readings; None where there is none near."""
        return self.history.at(stamp / SECOND)


def _jump(last: Floats, pose: Floats, seconds: float) -> tuple[Reason, str] | None:
    distance = float(np.hypot(*(pose - last)[:2]))
    turn = abs(wrapped(float(pose[2] - last[2])))
    if distance > _JUMP[0] + _JUMP[1] * seconds:
        return Reason.ODOMETRY_JUMPED, f"the odometry jumped by {distance:.1f} m in {seconds:.2f} s"
    if turn > _TURN[0] + _TURN[1] * seconds:
        degrees = np.degrees(turn)
        return Reason.ODOMETRY_JUMPED, f"the odometry turned by {degrees:.0f}° in {seconds:.2f} s"
    return None
