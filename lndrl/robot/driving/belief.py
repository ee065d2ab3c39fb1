"""Where the robot believes to be: by our AMCL, or by what its own localization says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.localization import AMCL, LikelihoodMap
from lndrl.maps.grid import OccupancyGrid
from lndrl.randomness import stream_state
from lndrl.robot.driving.maps import RobotMap
from lndrl.robot.driving.odometry import Wheels
from lndrl.robot.driving.reasons import Reason
from lndrl.robot.driving.scans import BaseScan, thinned
from lndrl.robot.geometry import between, chained
from lndrl.robot.messages import SECOND, Odometry, StampedPose

Floats = NDArray[np.float64]

_DISAGREES = 0.15
"""Share of echoes that the map explains, below which the pose is no pose of this map."""
_FOR = 4.0
"""s of driving for which a belief must be that bad: filters recover, but only while they drive."""
_MOVING = (0.01, 0.01)
"""m/s and rad/s from which the robot counts as driving."""
_UNSEEN = (0.6, 0.6)
"""m and rad of driving without a pose from the robot; ROS's AMCL speaks every 0.25 m or 0.2 rad."""


@dataclass(frozen=True)
class Estimate:
    """A belief at ``stamp``: pose (3,) and covariance (3, 3), map frame; particles (n, 3), a copy.

    ``agreement`` is the share of echoes that the map explains, ``effective`` how many particles
    matter; NaN where that is not known.
    """

    stamp: int
    pose: Floats
    covariance: Floats
    particles: Floats
    agreement: float = np.nan
    effective: float = np.nan

    @property
    def variance(self) -> Floats:
        """(3,) of x, y, yaw."""
        return np.diagonal(self.covariance).copy()


class Localization(Protocol):
    """What drivers ask; ``fault`` is why the estimate may not be driven by."""

    fault: tuple[Reason, str] | None

    def enter(self, map_: RobotMap) -> None:
        """Localize on ``map_`` from now on."""

    def begin(self, pose: Floats, covariance: Floats | None, stamp: int) -> None:
        """The robot is at ``pose``, somebody says."""

    def hear(self, told: StampedPose, wheels: Wheels) -> None:
        """The robot's own localization says something."""

    def forget(self) -> None:
        """Odometry or time jumped: there is no pose until somebody gives one."""

    def update(self, scan: BaseScan, wheels: Wheels) -> Estimate | None:
        """The belief at the moment of ``scan``; None while there is none."""


class OwnLocalization:
    """Our AMCL with the settings of ``config``; ``seed`` starts its draws."""

    def __init__(self, config: RunConfig, seed: int) -> None:
        self.fault: tuple[Reason, str] | None = None
        self._config = config
        self._random = stream_state(seed, 0)
        self._map: RobotMap | None = None
        self._filter: AMCL | None = None
        self._reach = np.nan
        self._told: tuple[Floats, Floats | None] | None = None
        self._doubt = Doubt(config)

    def warm_up(self) -> None:
        """Update another filter once about nothing, so that all is compiled before it matters."""
        walls = np.pad(np.zeros((38, 38), bool), 1, constant_values=True)
        other = OwnLocalization(self._config, 0)
        other.enter(RobotMap.of_grid("", OccupancyGrid(walls, 0.1), 0.1))
        other.begin(np.array([2.0, 2.0, 0.0]), np.eye(3) * 0.01, 0)
        wheels = Wheels()
        bearings = np.linspace(-1.5, 1.5, 60).astype(np.float32)
        for stamp in (1, 2):
            wheels.add(Odometry(stamp, "", "", np.array([0.1 * stamp, 0.0, 0.0])))
            ranges = np.full(60, 1.5, np.float32)
            other.update(BaseScan(stamp, bearings, ranges, 12.0, 0.05), wheels)
        other.begin(np.array([2.0, 2.0, 0.0]), None, 2)  # the other way to begin
        other.update(BaseScan(2, bearings, ranges, 12.0, 0.05), wheels)

    def enter(self, map_: RobotMap) -> None:
        """See ``Localization``: the belief stays where it was."""
        self._map = map_
        if self._filter is not None:
            before, self._filter = self._filter, self._make(self._reach)
            self._filter.restore(before.snapshot())

    def begin(self, pose: Floats, covariance: Floats | None, stamp: int) -> None:
        """See ``Localization``: the cloud is drawn when the next scan comes."""
        known = covariance is not None and np.isfinite(covariance).all() and covariance.any()
        self._told = pose.copy(), covariance if known else None

    def hear(self, told: StampedPose, wheels: Wheels) -> None:
        """See ``Localization``: it is where to begin, where nobody has said anything else."""
        if self._filter is None and self._told is None:
            self.begin(told.pose, told.covariance, told.stamp)

    def forget(self) -> None:
        """See ``Localization``."""
        self._filter, self._told = None, None

    def update(self, scan: BaseScan, wheels: Wheels) -> Estimate | None:
        """See ``Localization``."""
        odometry = wheels.at(scan.stamp)
        if odometry is None or self._map is None:
            return None
        if self._told is not None:
            self._start(scan, odometry)
        if self._filter is None:
            return None
        if scan.range_max != self._reach:
            self._reach = scan.range_max
            self.enter(self._map)
        ranges, bearings = thinned(scan, self._config.localization.laser_max_beams)
        self._filter.update(odometry, ranges, bearings)
        found = Estimate(
            scan.stamp, self._filter.pose_estimated.copy(), self._filter.covariance.copy(),
            self._filter.particles.copy(), self._filter.beam_agreement,
            self._filter.effective_count,
        )  # fmt: skip
        self.fault = self._doubt.fault(found, wheels)
        return found

    def _start(self, scan: BaseScan, odometry: Floats) -> None:
        assert self._told is not None
        pose, covariance = self._told
        self._told, self._reach = None, scan.range_max
        self._filter = self._make(scan.range_max)
        self._doubt = Doubt(self._config)
        self._random = self._random + np.uint64(1)  # another start draws anew
        try:
            self._filter.reset(pose, self._random, odometry, covariance)
        except ValueError:  # a covariance that is none
            self._filter.reset(pose, self._random, odometry)

    def _make(self, reach: float) -> AMCL:
        assert self._map is not None
        laser = self._config.world.laser.model_copy(update={"range_max": reach})
        settings = self._config.localization
        return AMCL(LikelihoodMap.build(self._map.grid, settings, laser), settings, laser)


class RobotLocalization:
    """What the robot's own localization says, carried on by the odometry until it speaks again."""

    def __init__(self, config: RunConfig) -> None:
        self.fault: tuple[Reason, str] | None = None
        self._config = config
        self._told: StampedPose | None = None
        self._odometry: Floats | None = None  # at the moment of that
        self._doubt = Doubt(config)

    def enter(self, map_: RobotMap) -> None:
        """See ``Localization``: it has its own."""

    def begin(self, pose: Floats, covariance: Floats | None, stamp: int) -> None:
        """See ``Localization``: the robot hears that as well, and is believed."""

    def hear(self, told: StampedPose, wheels: Wheels) -> None:
        """See ``Localization``; one that is older than the last is left out."""
        if self._told is not None and told.stamp < self._told.stamp:
            return
        at = wheels.at(told.stamp)
        self._told, self._odometry = told, wheels.newest if at is None else at

    def forget(self) -> None:
        """See ``Localization``."""
        self._told = self._odometry = None

    def update(self, scan: BaseScan, wheels: Wheels) -> Estimate | None:
        """See ``Localization``."""
        odometry = wheels.at(scan.stamp)
        if odometry is None or self._told is None or self._told.covariance is None:
            return None
        if self._odometry is None:
            self._odometry = odometry
        moved = between(self._odometry, odometry)
        pose = chained(self._told.pose, moved)
        found = Estimate(scan.stamp, pose, self._told.covariance, pose[None])
        self.fault = self._doubt.fault(found, wheels)
        distance, turn = float(np.hypot(*moved[:2])), abs(float(moved[2]))
        if self.fault is None and (distance > _UNSEEN[0] or turn > _UNSEEN[1]):
            words = f"the robot's localization is silent for {distance:.2f} m and {turn:.2f} rad"
            self.fault = Reason.POSE_STALE, words
        return found


class Doubt:
    """For how long a belief has been too wide, or at odds with the scan, while the robot drove."""

    def __init__(self, config: RunConfig) -> None:
        self._widest = float(config.task.lost_distance)
        self._last: int | None = None
        self._seconds = 0.0

    def fault(self, estimate: Estimate, wheels: Wheels) -> tuple[Reason, str] | None:
        """Why ``estimate`` may not be driven by; None where it may."""
        if not (np.isfinite(estimate.pose).all() and np.isfinite(estimate.covariance).all()):
            return Reason.POSE_INVALID, "the pose or its covariance is not finite"
        x, y, _ = estimate.variance
        wide = float(np.sqrt(max(x + y, 0.0)))
        # 0 stands for no update yet, and NaN for not known.
        at_odds = 0.0 < estimate.agreement < _DISAGREES
        passed = 0.0 if self._last is None else (estimate.stamp - self._last) / SECOND
        self._last = estimate.stamp
        if not (wide > self._widest or at_odds):
            self._seconds = 0.0
        elif (np.abs(wheels.velocity) > _MOVING).any():
            self._seconds += min(max(passed, 0.0), 1.0)
        if self._seconds <= _FOR:
            return None
        if at_odds:
            share = f"{100 * estimate.agreement:.0f} %"
            return Reason.POSE_LOST, f"the map explains {share} of the scan"
        return Reason.POSE_LOST, f"the belief is {wide:.1f} m wide"
