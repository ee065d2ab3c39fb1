"""A filter on a recorded drive: as it was, and after trouble in the middle of it."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from lndrl.config import LaserConfig, LocalizationConfig, TaskConfig
from lndrl.evaluation.localization.drives import DRIVE_WORLD, Drive
from lndrl.evaluation.localization.figures import (
    Outcome,
    errors,
    lost_ticks,
    recovery_seconds,
    rmse,
)
from lndrl.localization import AMCL, LikelihoodMap, amcl_beam_stride
from lndrl.randomness import Stream, stream_state
from lndrl.world import beam_bearings

Floats = NDArray[np.float64]


TOLD, CARRIED, GLOBAL = "told", "carried", "global"
TROUBLES = {
    TOLD: "told a pose 3 m off",
    CARRIED: "carried 3 m",
    GLOBAL: "knows nothing",
}
"""What happens halfway. Told: reset at a wrong pose, the filter starts anew and is sure. Carried:
the cloud is 3 m off and everything else that the filter knows stays. Global: a uniform cloud."""


@dataclass(frozen=True, eq=False)
class Replay:
    """What the filter said after each of n ticks.

    ``estimated`` ``(n, 3)`` poses; ``particles`` (n,) counts, ``effective`` (n,) effective counts,
    ``seconds`` (n,) of wall clock, 0 where the filter was not asked.
    """

    estimated: Floats
    particles: NDArray[np.int64]
    effective: Floats
    seconds: Floats


class Replayer:
    """A filter under one setting for any number of drives of a place."""

    def __init__(
        self, field: LikelihoodMap, config: LocalizationConfig, laser: LaserConfig, task: TaskConfig
    ) -> None:
        self.filter = AMCL(field, config, laser)
        self._lost = task.lost_distance, task.lost_angle
        self._stride = amcl_beam_stride(laser, config)
        self._bearings = beam_bearings(laser)[:: self._stride].astype(np.float32)
        self._heard = config.update_ticks or [1]

    def outcome(self, drive: Drive, seed: int, setting: str, scenario: str, people: int) -> Outcome:
        """Figures of the whole drive and of every trouble halfway; see ``Outcome``."""
        whole = self.whole(drive, seed)
        position, yaw = errors(whole.estimated, drive.truth)
        lost = lost_ticks(position, yaw, *self._lost)
        return Outcome(
            setting=setting,
            scenario=scenario,
            pedestrians=people,
            seed=seed,
            position_rmse=rmse(position),
            yaw_rmse=rmse(yaw),
            worst=float(position.max()),
            lost=bool(lost.any()),
            lost_time=float(lost.mean()),
            particles=float(whole.particles.mean()),
            effective=float(whole.effective.mean()),
            microseconds=1e6 * float(np.median(whole.seconds[whole.seconds > 0.0])),
            recovery={
                kind: recovery_seconds(self.after(kind, drive, seed), drive.tick)
                for kind in TROUBLES
            },
            errors=position.astype(np.float32),
        )

    def whole(self, drive: Drive, seed: int) -> Replay:
        """The drive from its start, which the filter is told."""
        self.filter.reset(drive.start, _state(seed, 0))
        return self._run(drive, 0, len(drive.truth))

    def after(self, kind: str, drive: Drive, seed: int) -> Floats:
        """Position errors (m) of the ticks after trouble ``kind`` halfway."""
        half = drive.halfway
        true, odometry = drive.truth[half - 1], drive.odometry[half - 1]
        if kind == TOLD:
            wrong = np.array([*drive.displaced, true[2]])
            self.filter.reset(wrong, _state(seed, 1), odometry)
        elif kind == CARRIED:
            self.filter.reset(drive.start, _state(seed, 0))
            self._run(drive, 0, half)
            # The robot moved and the cloud stayed; here the cloud moves, which looks the same.
            shift = drive.displaced - true[:2]
            self.filter.particles[:, :2] += shift
            self.filter.pose_estimated[:2] += shift
        else:
            self.filter.reset(true, _state(seed, 2), odometry)
            self.filter.global_localization()
        position, _ = errors(self._run(drive, half, len(drive.truth)).estimated, drive.truth[half:])
        return position

    def _hears(self, tick: int) -> bool:
        """Whether ``localization.update_ticks`` names the tick, counted from 0."""
        return tick % self._heard[-1] + 1 in self._heard

    def _run(self, drive: Drive, first: int, last: int) -> Replay:
        count = last - first
        ranges = np.ascontiguousarray(drive.ranges[first:last, :: self._stride])
        estimated, seconds = np.zeros((count, 3)), np.zeros(count)
        particles = np.zeros(count, dtype=np.int64)
        effective = np.zeros(count)
        for i in range(count):
            if self._hears(first + i):
                started = perf_counter()
                self.filter.update(drive.odometry[first + i], ranges[i], self._bearings)
                seconds[i] = perf_counter() - started
            estimated[i] = self.filter.pose_estimated
            particles[i] = self.filter.count
            effective[i] = self.filter.effective_count
        return Replay(estimated, particles, effective, seconds)


def _state(seed: int, use: int) -> NDArray[np.uint64]:
    return stream_state(seed, DRIVE_WORLD, use, Stream.LOCALIZATION)
