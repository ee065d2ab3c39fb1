"""Filters on recorded drives, once per seed: errors, lost drives, kidnapped robots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.evaluation.localization.drives import SensorLog
from lndrl.evaluation.localization.figures import errors
from lndrl.localization import AMCL, LikelihoodMap, amcl_beam_stride
from lndrl.maps.grid import OccupancyGrid
from lndrl.randomness import Stream, stream_state
from lndrl.world import beam_bearings

LOST = 0.5
"""m: a drive with a larger position RMSE counts as lost."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Outcome:
    """Errors of every drive with every filter seed.

    ``position_error`` (m) and ``yaw_error`` (rad, absolute) are (drives * seeds, T).
    """

    position_error: Floats
    yaw_error: Floats

    @property
    def position_rmse(self) -> Floats:
        """Position RMSE (m) of each drive."""
        rmse: Floats = np.sqrt(np.mean(self.position_error**2, axis=1))
        return rmse

    @property
    def yaw_rmse(self) -> Floats:
        """Yaw RMSE (rad) of each drive."""
        rmse: Floats = np.sqrt(np.mean(self.yaw_error**2, axis=1))
        return rmse

    @property
    def lost(self) -> int:
        """Drives with a position RMSE above ``LOST``."""
        return int((self.position_rmse > LOST).sum())


def kidnapped(first: SensorLog, second: SensorLog) -> SensorLog:
    """``first``, then without a word of the odometer ``second``: the robot was carried there."""
    x, y, yaw = first.odometry[-1]
    c, s = math.cos(yaw), math.sin(yaw)
    further = np.empty_like(second.odometry)
    further[:, 0] = x + c * second.odometry[:, 0] - s * second.odometry[:, 1]
    further[:, 1] = y + s * second.odometry[:, 0] + c * second.odometry[:, 1]
    further[:, 2] = np.remainder(yaw + second.odometry[:, 2] + math.pi, 2.0 * math.pi) - math.pi
    return SensorLog(
        first.start,
        np.concatenate([first.truth, second.truth]),
        np.concatenate([first.odometry, further]),
        np.concatenate([first.ranges, second.ranges]),
        first.hits,
    )


def replay(
    drives: Sequence[SensorLog],
    grid: OccupancyGrid,
    config: LocalizationConfig,
    laser: LaserConfig,
    seeds: int = 5,
) -> Outcome:
    """Every drive through a filter of ``config``, once per seed, told the true start."""
    field = LikelihoodMap.build(grid, config)
    amcl = AMCL(field, config, laser)
    stride = amcl_beam_stride(laser, config)
    bearings = beam_bearings(laser)[::stride].astype(np.float32)
    position, yaw = [], []
    for number, drive in enumerate(drives):
        ranges = np.ascontiguousarray(drive.ranges[:, ::stride])
        for seed in range(seeds):
            amcl.reset(drive.start, stream_state(seed, number, 0, Stream.LOCALIZATION))
            estimates = np.empty_like(drive.truth)
            for i in range(len(ranges)):
                amcl.update(drive.odometry[i], ranges[i], bearings)
                estimates[i] = amcl.pose_estimated
            off, turned = errors(estimates, drive.truth)
            position.append(off)
            yaw.append(turned)
    return Outcome(np.array(position), np.array(yaw))
