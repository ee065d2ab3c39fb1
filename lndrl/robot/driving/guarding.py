"""The guard of a drive: what it sees of the senses, and what it says when it lets nothing through.

What is guaranteed, and under which assumptions: docs/guard.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.localization import relative
from lndrl.planners import GuardConfig
from lndrl.robot.driving.belief import Estimate
from lndrl.robot.driving.maps import RobotMap
from lndrl.robot.driving.scans import BaseScan
from lndrl.robot.driving.senses import Senses
from lndrl.robot.guard import Base, CommandGuard, Sight, braked_evenly, moved_by
from lndrl.robot.messages import SECOND
from lndrl.world.odometry import velocities

Floats = NDArray[np.float64]

_TICK = 0.1
"""s, in whose steps paths are predicted."""
_LONGEST = 1.0
"""s beyond which nobody foretells where the wheels will have led."""


@dataclass(frozen=True)
class Verdict:
    """What may be told to the base, and in words why it is not what was asked for."""

    v: float
    w: float
    words: str = ""


class DriveGuard:
    """Looks at every command of a drive before it leaves.

    ``actions`` (A, 2) are what may be taken instead; ``period`` (s): within which another command
    follows. Sees the scan that was last localized with.
    """

    def __init__(self, parameters: GuardConfig, base: Base, actions: Floats, period: float) -> None:
        self.parameters, self.base = parameters, base
        self._actions, self._period = actions, max(period, base.timeout)
        fastest = float(np.abs(actions[:, 0]).max(initial=0.0))
        self._limits = braked_evenly(base.limits, fastest, _TICK)
        self._map: RobotMap | None = None
        self._guard: CommandGuard | None = None
        self._seen: Estimate | None = None
        self._sight: Sight | None = None

    def check(
        self,
        wanted: tuple[float, float],
        last: tuple[float, float],
        senses: Senses,
        now: float,
        choices: Callable[[], Floats],
        scores: NDArray[np.floating] | None,
    ) -> Verdict:
        """What may leave at ``now`` (s) instead of ``wanted``, after ``last`` was sent.

        ``choices`` gives the actions (A, 2) as far as they may be taken up now, ``scores`` (A,) how
        much each is liked; None: the nearest is.
        """
        scan, estimate = senses.scan, senses.estimate
        age = senses.scan_age(now)
        odometry = None if scan is None else senses.wheels.at(scan.stamp)
        if scan is None or estimate is None or age is None or odometry is None:
            return Verdict(0.0, 0.0, "there is no scan to go by")
        sight, guard = self._look(scan, estimate, senses.map)
        newest, stamp = senses.wheels.newest, senses.wheels.stamp
        assert newest is not None and stamp is not None
        # Where the base will be when the command is felt, from where it was at the scan, and how
        # fast: from the odometry's moment on it follows what was sent.
        left = age + self.parameters.delay - (stamp - scan.stamp) / SECOND
        if left > _LONGEST:
            return Verdict(
                0.0, 0.0, f"what is seen will be {left:.1f} s old when a command is felt"
            )
        left = max(left, 0.0)
        ahead = self._ahead(senses.wheels.velocity, last, left)
        moved = moved_by(ahead.mean(axis=0), left, relative(odometry, newest))
        told, passed = guard.check(wanted, ahead[-1], sight, moved, age, choices, scores)
        v, w = told.tolist()
        same = passed or (v, w) == wanted
        return Verdict(v, w, "" if same else _words(sight, moved))

    def _ahead(self, speed: Floats, last: tuple[float, float], seconds: float) -> Floats:
        """Velocities (ticks, 2) for ``seconds`` from ``speed`` on, after ``last`` was sent.

        Where that is slower it may not be felt before the next command is, and is not relied on.
        """
        v, w = last
        told = np.array([[speed[0] if abs(v) < abs(speed[0]) else v, w]])
        ticks = max(1, math.ceil(seconds / _TICK - 1e-9))
        return velocities(speed, told, self.base.limits, _TICK, ticks)[0]

    def _look(
        self, scan: BaseScan, estimate: Estimate, map_: RobotMap | None
    ) -> tuple[Sight, CommandGuard]:
        """What ``scan`` shows, on ``map_``; looked at once."""
        if self._guard is None or map_ is not self._map:
            self._map, self._seen = map_, None
            self._guard = CommandGuard(
                self.parameters, self.base.radius, self._limits, self._actions, self._period,
                _TICK, None if map_ is None else map_.grid, revised=True,
            )  # fmt: skip
        if self._sight is None or estimate is not self._seen:
            self._seen = estimate
            self._sight = self._guard.look(
                scan.own.ranges, scan.own_bearings, scan.scanner, estimate.pose
            )
        return self._sight, self._guard


def _words(sight: Sight, moved: Floats) -> str:
    """What is nearest, in words."""
    if not len(sight.echoes):
        return "nothing is seen, and yet no way is safe"
    offset = sight.echoes - moved[:2]
    away = np.hypot(offset[:, 0], offset[:, 1])
    # What may move asks for more room; a wall matters where nothing else is near.
    nearest = int(np.where(sight.movable, away - 1.0, away).argmin())
    what = "what may move" if sight.movable[nearest] else "a wall"
    bearing = math.degrees(math.atan2(offset[nearest, 1], offset[nearest, 0]) - moved[2])
    bearing = math.remainder(bearing, 360.0)
    side = "ahead" if abs(bearing) < 15.0 else f"{abs(bearing):.0f}° to the "
    if side != "ahead":
        side += "left" if bearing > 0.0 else "right"
    return f"{what} is {away[nearest]:.1f} m away, {side}"
