"""The filter behind a real scanner and odometer: stamps, mount, echoes, and how well it stands."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.localization.amcl import AMCL, beam_stride
from lndrl.localization.belief import Vector
from lndrl.localization.likelihood import LikelihoodMap
from lndrl.localization.scanner import Scanner
from lndrl.localization.stamps import OdometryHistory, compose, relative
from lndrl.maps.grid import OccupancyGrid
from lndrl.randomness import State


class Heard(StrEnum):
    """What became of a scan."""

    UPDATED = "updated"
    STILL = "still"  # the robot has not moved enough for an update
    EARLY = "early"  # no odometer reading yet for its time: offer it again
    LATE = "late"  # older than what the odometer remembers, or than the last scan
    BLIND = "blind"  # too few echoes to learn from
    BAD_ODOMETRY = "bad odometry"  # the odometer says what cannot be


@dataclass(frozen=True)
class Health:
    """How well the belief stands.

    ``effective_share``: the effective count over the particles, before the last resampling.
    ``agreement``: share of the last scan's echoes that the map explains from the estimate.
    ``second_cluster``: share of the weight in the second heaviest cluster. ``deviation`` (m): root
    of the variance of x and y together. ``echoes``: usable beams of the last scan that was heard.
    ``silence`` (s): since the last scan with enough of them, infinite before the first.
    """

    effective_share: float
    agreement: float
    second_cluster: float
    deviation: float
    echoes: int
    silence: float


class SensorFilter:
    """AMCL for one robot with a real scanner.

    Odometer readings and scans come with their stamps (s, one clock), as they arrive; the scan is
    taken with the odometer's pose at its stamp. ``least_echoes``: a scan with fewer usable beams,
    of those that the filter would use, is not weighed, it only moves the cloud. ``ahead`` (s): see
    ``OdometryHistory``. ``odometer``: one that somebody else feeds, too; by default an own one.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        config: LocalizationConfig,
        scanner: Scanner,
        least_echoes: int = 5,
        ahead: float = 0.05,
        odometer: OdometryHistory | None = None,
    ) -> None:
        # The scanner's maximum is the laser's: there is one, and the configuration may lower it.
        laser = LaserConfig(beams=config.laser_max_beams, range_max=scanner.range_max)
        self.scanner = scanner
        self.amcl = AMCL(LikelihoodMap.build(grid, config, laser), config, laser, scanner=scanner)
        self.odometer = OdometryHistory(ahead=ahead) if odometer is None else odometer
        self._range_max = np.float32(config.max_range(scanner.range_max))
        self._range_min = np.float32(config.min_range(scanner.range_min))
        self._least, self._max_beams = least_echoes, config.laser_max_beams
        self._echoes = 0
        self._taken = self._usable = -math.inf  # stamps of the last scan, and of the last good one
        self._reference = np.zeros(3)  # the odometer's pose that the estimate belongs to

    def reset(
        self,
        pose: ArrayLike,
        state: State,
        pose_odometry: ArrayLike,
        covariance: ArrayLike | None = None,
    ) -> None:
        """Start at ``pose`` (m, m, rad; map frame) with the odometer at ``pose_odometry``.

        Arguments and errors as for ``AMCL.reset``. Scans from before are forgotten.
        """
        self.amcl.reset(pose, state, pose_odometry, covariance)
        self._reference = np.array(pose_odometry, dtype=np.float64)
        self._taken = self._usable = -math.inf
        self._echoes = 0

    def take_up(self, before: SensorFilter) -> None:
        """Go on with the belief of ``before``: the same robot on another map, or another scanner.

        Raises ValueError where that has room for another number of particles.
        """
        self.amcl.restore(before.amcl.snapshot())
        self._reference = before._reference
        self._taken, self._usable, self._echoes = before._taken, before._usable, before._echoes

    def add_odometry(self, stamp: float, pose: ArrayLike) -> bool:
        """Take an odometer reading (3,); False if it is not finite or not newer than the last."""
        return self.odometer.add(stamp, pose)

    def add_scan(
        self,
        stamp: float,
        ranges: NDArray[np.floating],
        angle_min: float,
        angle_increment: float,
        farthest: float | None = None,
    ) -> Heard:
        """Take a scan of any number of beams; the arguments are those of a LaserScan message.

        ``farthest`` (m) is the message's own ``range_max``, where it says one. What is not
        ``UPDATED`` leaves the belief as it was, but for ``BLIND``, which moves it by the odometer.
        Raises ValueError before the first ``reset``.
        """
        if not math.isfinite(stamp) or stamp <= self._taken:
            return Heard.LATE
        odometry = self.odometer.at(stamp)
        if odometry is None:
            return Heard.LATE if stamp < self.odometer.oldest else Heard.EARLY
        clean = self.scanner.echoes(ranges, farthest)
        used = clean[:: beam_stride(len(clean), self._max_beams)]
        with np.errstate(invalid="ignore"):
            echoes = int(((used > self._range_min) & (used < self._range_max)).sum())
        refused = self.amcl.ignored_odometry
        if echoes < self._least:
            moved = self.amcl.predict(odometry)
            result = Heard.BLIND
        else:
            bearings = self.scanner.bearings(angle_min, angle_increment, len(clean))
            moved = self.amcl.update(odometry, clean, bearings)
            result = Heard.UPDATED if moved else Heard.STILL
            if self.amcl.ignored_odometry > refused:
                return Heard.BAD_ODOMETRY
            self._usable = stamp
        self._taken, self._echoes = stamp, echoes
        if moved:
            self._reference = odometry
        return result

    def pose(self, stamp: float | None = None) -> Vector:
        """The estimate (3,) moved on by the odometer to ``stamp``, by default to its newest.

        Where no reading tells that time, the newest that there is. Nothing in the filter changes.
        """
        return compose(self.amcl.pose_estimated, self._moved(stamp))

    def cloud(self, stamp: float | None = None) -> Vector:
        """The particles (n, 3), a copy, each moved on as ``pose`` moves the estimate."""
        cloud = self.amcl.particles.copy()
        dx, dy, turn = self._moved(stamp)
        c, s = np.cos(cloud[:, 2]), np.sin(cloud[:, 2])
        cloud[:, 0] += c * dx - s * dy
        cloud[:, 1] += s * dx + c * dy
        cloud[:, 2] = np.remainder(cloud[:, 2] + turn + np.pi, 2.0 * np.pi) - np.pi
        return cloud

    def _moved(self, stamp: float | None) -> Vector:
        """By how much (3,) the odometer has moved since what the estimate belongs to."""
        newest = self.odometer.newest
        odometry = self.odometer.at(newest if stamp is None else stamp)
        if odometry is None:
            odometry = self.odometer.at(newest)
        return np.zeros(3) if odometry is None else relative(self._reference, odometry)

    def health(self, now: float) -> Health:
        """How well the belief stands at ``now`` (s, the stamps' clock)."""
        amcl = self.amcl
        _, second = amcl.cluster_masses()
        return Health(
            effective_share=min(1.0, amcl.effective_count / max(amcl.count, 1)),
            agreement=amcl.beam_agreement,
            second_cluster=second,
            deviation=math.sqrt(float(amcl.variance[0] + amcl.variance[1])),
            echoes=self._echoes,
            silence=now - self._usable,
        )
