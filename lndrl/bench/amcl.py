"""``lndrl bench amcl``: one localization update, with fixed numbers of particles."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.bench.report import REPETITIONS
from lndrl.bench.scene import hybrid_config
from lndrl.config import LocalizationConfig, RunConfig
from lndrl.localization import AMCL, LikelihoodMap, amcl_beam_stride
from lndrl.navigation import build_surroundings
from lndrl.randomness import Stream, stream_state
from lndrl.world import Place, World

PARTICLES = (500, 2000)
_TICKS = 200
_DRIVE = (0.4, 0.15)
"""m/s, rad/s: a wide circle, so that every tick passes the update thresholds."""


@dataclass(frozen=True)
class _Recording:
    """Sensor readings of one drive: odometry (T, 3), ranges (T, beams), bearings (beams,)."""

    start: NDArray[np.float64]
    odometry: NDArray[np.float64]
    ranges: NDArray[np.float32]
    bearings: NDArray[np.float32]


def measure(seconds: float) -> dict[str, Any]:
    """``update_microseconds`` by ``PARTICLESxBEAMS``: motion, laser, resampling, pose estimate.

    Replays one drive through the hybrid scenario, every update of which passes the thresholds.
    Particle counts are held fixed by equal limits, the worst case of adaptive sampling.
    """
    config = hybrid_config()
    place, field = build_surroundings(config)
    recording = _record(config, place)
    beams = len(recording.bearings)
    return {
        "update_microseconds": {
            f"{count}x{beams}": 1e6 * _update_seconds(config, field, recording, count, seconds)
            for count in PARTICLES
        }
    }


def _record(config: RunConfig, place: Place) -> _Recording:
    stride = amcl_beam_stride(config.world.laser, config.localization)
    used = np.arange(0, config.world.laser.beams, stride)
    fan = config.world.laser.field_of_view
    bearings = (used * (fan / config.world.laser.beams) - 0.5 * fan).astype(np.float32)
    world = World(place, config.world)
    odometry, ranges = [], []
    world.reset(config.seed, 0, 0)
    start = world.start_pose.copy()
    world.begin_step(*_DRIVE)
    for _ in range(_TICKS):
        world.tick()
        odometry.append(world.pose_odometry.copy())
        ranges.append(world.scan_sparse(stride).copy())
    return _Recording(start, np.array(odometry), np.array(ranges), bearings)


def _update_seconds(
    config: RunConfig, field: LikelihoodMap, recording: _Recording, count: int, seconds: float
) -> float:
    limits = {"min_particles": count, "max_particles": count}
    localization = LocalizationConfig.model_validate({**config.localization.model_dump(), **limits})
    amcl = AMCL(field, localization, config.world.laser)
    _replay(amcl, recording, config.seed)
    times: list[float] = []
    while len(times) < REPETITIONS or sum(times) * _TICKS < seconds:
        times.append(_replay(amcl, recording, config.seed))
    return statistics.median(times)


def _replay(amcl: AMCL, recording: _Recording, seed: int) -> float:
    """Mean seconds of the updates that moved the filter, from the start of the recording."""
    amcl.reset(recording.start, stream_state(seed, 0, 0, Stream.LOCALIZATION))
    updates = 0
    started = perf_counter()
    for pose, ranges in zip(recording.odometry, recording.ranges, strict=True):
        updates += amcl.update(pose, ranges, recording.bearings)
    return (perf_counter() - started) / updates
