"""Where the robot believes to be: by our AMCL, or by what its own localization says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.localization import Health, OdometryHistory, Scanner, SensorFilter
from lndrl.maps.grid import OccupancyGrid
from lndrl.randomness import stream_state
from lndrl.robot.driving.maps import RobotMap
from lndrl.robot.driving.odometry import Wheels
from lndrl.robot.driving.reasons import Reason
from lndrl.robot.driving.scans import BaseScan, about_base
from lndrl.robot.geometry import between, chained
from lndrl.robot.messages import SECOND, Odometry, Scan, StampedPose

Floats = NDArray[np.float64]

_DISAGREES = 0.15
"""Share of echoes that the map explains, below which the pose is no pose of this map."""
_TORN = 0.4
"""Share of the weight in the second heaviest cluster from which there are two places."""
_FOR = 4.0
"""s of driving for which a belief must be that bad: filters recover, but only while they drive."""
_MOVING = (0.01, 0.01)
"""m/s and rad/s from which the robot counts as driving."""
_UNSEEN = (0.6, 0.6)
"""m and rad of driving without a pose from the robot; ROS's AMCL speaks every 0.25 m or 0.2 rad."""


@dataclass(frozen=True)
class Estimate:
    """A belief at ``stamp``: pose (3,) and covariance (3, 3), map frame; particles (n, 3), a copy.

    ``health``: how well it stands, where it is our filter's.
    """

    stamp: int
    pose: Floats
    covariance: Floats
    particles: Floats
    health: Health | None = None

    @property
    def variance(self) -> Floats:
        """(3,) of x, y, yaw."""
        return np.diagonal(self.covariance).copy()

    @property
    def agreement(self) -> float:
        """Share of the scan's echoes that the map explains; NaN where that is not known."""
        return np.nan if self.health is None else self.health.agreement

    @property
    def effective(self) -> float:
        """How many particles matter; NaN where that is not known."""
        return np.nan if self.health is None else self.health.effective_share * len(self.particles)


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
    """Our filter behind the robot's scanner, by ``config``; ``seed`` starts its draws."""

    def __init__(self, config: RunConfig, seed: int) -> None:
        self.fault: tuple[Reason, str] | None = None
        self._config = config
        self._random = stream_state(seed, 0)
        self._map: RobotMap | None = None
        self._filter: SensorFilter | None = None
        self._told: tuple[Floats, Floats | None] | None = None
        self._doubt = Doubt(config)

    def warm_up(self) -> None:
        """Update another filter once about nothing, so that all is compiled before it matters."""
        walls = np.pad(np.zeros((38, 38), bool), 1, constant_values=True)
        other = OwnLocalization(self._config, 0)
        other.enter(RobotMap.of_grid("", OccupancyGrid(walls, 0.1), 0.1))
        other.begin(np.array([2.0, 2.0, 0.0]), np.eye(3) * 0.01, 0)
        wheels = Wheels()
        ranges = np.full(60, 1.5, np.float32)
        for stamp in (SECOND, 2 * SECOND):
            wheels.add(Odometry(stamp, "", "", np.array([0.5 * stamp / SECOND, 0.0, 0.0])))
            scan = Scan(stamp, "", -1.5, 0.05, 0.0, 12.0, ranges)
            other.update(about_base(scan, Scanner()), wheels)
        other.begin(np.array([2.0, 2.0, 0.0]), None, 2)  # the other way to begin
        other.update(about_base(scan, Scanner()), wheels)

    def enter(self, map_: RobotMap) -> None:
        """See ``Localization``: the belief stays where it was."""
        self._map = map_
        if self._filter is not None:
            self._renew(self._filter.scanner, self._filter.odometer)

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
            self._start(scan, odometry, wheels)
        if self._filter is None:
            return None
        if scan.scanner != self._filter.scanner:
            self._renew(scan.scanner, wheels.history)
        own, stamp = scan.own, scan.stamp / SECOND
        self._filter.add_scan(stamp, own.ranges, own.angle_min, own.angle_increment)
        amcl, health = self._filter.amcl, self._filter.health(stamp)
        found = Estimate(
            scan.stamp, self._filter.pose(stamp), amcl.covariance.copy(),
            self._filter.cloud(stamp), health,
        )  # fmt: skip
        self.fault = self._doubt.fault(found, wheels)
        return found

    def _start(self, scan: BaseScan, odometry: Floats, wheels: Wheels) -> None:
        assert self._told is not None
        (pose, covariance), self._told = self._told, None
        self._filter = self._make(scan.scanner, wheels.history)
        self._doubt = Doubt(self._config)
        self._random = self._random + np.uint64(1)  # another start draws anew
        try:
            self._filter.reset(pose, self._random, odometry, covariance)
        except ValueError:  # a covariance that is none
            self._filter.reset(pose, self._random, odometry)

    def _renew(self, scanner: Scanner, history: OdometryHistory) -> None:
        assert self._filter is not None
        before, self._filter = self._filter, self._make(scanner, history)
        self._filter.take_up(before)

    def _make(self, scanner: Scanner, history: OdometryHistory) -> SensorFilter:
        assert self._map is not None
        settings = self._config.localization
        return SensorFilter(self._map.grid, settings, scanner, odometer=history)


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
    """For how long a belief has been too wide, torn, or at odds with the scan, while it drove."""

    def __init__(self, config: RunConfig) -> None:
        self._widest = float(config.task.lost_distance)
        self._last: int | None = None
        self._seconds = 0.0

    def fault(self, estimate: Estimate, wheels: Wheels) -> tuple[Reason, str] | None:
        """Why ``estimate`` may not be driven by; None where it may."""
        if not (np.isfinite(estimate.pose).all() and np.isfinite(estimate.covariance).all()):
            return Reason.POSE_INVALID, "the pose or its covariance is not finite"
        doubt = self._doubt(estimate)
        passed = 0.0 if self._last is None else (estimate.stamp - self._last) / SECOND
        self._last = estimate.stamp
        if doubt is None:
            self._seconds = 0.0
        elif (np.abs(wheels.velocity) > _MOVING).any():
            self._seconds += min(max(passed, 0.0), 1.0)
        return doubt if self._seconds > _FOR else None

    def _doubt(self, estimate: Estimate) -> tuple[Reason, str] | None:
        """What speaks against ``estimate`` at this moment."""
        x, y, _ = estimate.variance
        wide, health = float(np.sqrt(max(x + y, 0.0))), estimate.health
        # An agreement of 0 stands for no update yet.
        if health is not None and 0.0 < health.agreement < _DISAGREES:
            share = f"{100 * health.agreement:.0f} %"
            return Reason.POSE_INCONSISTENT, f"the map explains {share} of the scan"
        if wide > self._widest:
            return Reason.POSE_LOST, f"the belief is {wide:.1f} m wide"
        if health is not None and health.second_cluster > _TORN:
            share = f"{100 * health.second_cluster:.0f} %"
            return Reason.POSE_LOST, f"{share} of the belief are at a second place"
        return None
