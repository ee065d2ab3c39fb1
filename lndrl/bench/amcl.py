"""``lndrl bench amcl``: one localization update, with fixed numbers of particles."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.bench.report import REPETITIONS
from lndrl.bench.scene import hybrid_config
from lndrl.bench.wandering import record_drives
from lndrl.config import LaserConfig, LocalizationConfig, RunConfig
from lndrl.evaluation.localization.drives import SensorLog
from lndrl.kernels import kernel
from lndrl.localization import (
    AMCL,
    LikelihoodMap,
    amcl_beam_stride,
    belief_of,
    kld_limits,
    make_beliefs,
    make_bins,
    make_field,
    make_scratch,
    make_settings,
    update_belief,
)
from lndrl.maps.grid import OccupancyGrid
from lndrl.randomness import Stream, stream_state
from lndrl.world import Place, beam_bearings

SIZES = {"500x60": (500, 60), "2000x60": (2000, 60), "2000x100": (2000, 100)}
"""Label: particles and ``laser_max_beams``; 100 of 720 is every seventh beam, so 103."""
MODELS = ("likelihood_field", "likelihood_field_prob", "beam")
_TICKS = 200
_BEAM_TICKS = 40
"""The beam model takes some milliseconds per update."""


def measure(seconds: float) -> dict[str, Any]:
    """``update_microseconds`` by ``PARTICLESxBEAMS``: motion, laser, resampling, pose estimate.

    Replays one drive through the hybrid scenario, every update of which passes the thresholds.
    Particle counts are held fixed by equal limits, the worst case of adaptive sampling.
    ``update_microseconds_compiled`` is the same without the Python wrapper, called from compiled
    code as worlds do; ``update_microseconds_by_model`` is 500x60 for every sensor model.
    """
    config = hybrid_config()
    place = Place.build(config.scenario, config.world.robot_radius)
    recording = record(config, place)
    laser = config.world.laser
    wrapped, compiled = {}, {}
    for label, (count, beams) in SIZES.items():
        fixed = fixed_count(config.localization, count, laser_max_beams=beams)
        filters = (place.grid, fixed, laser, recording)
        wrapped[label] = 1e6 * _median(_wrapped(*filters), seconds)
        compiled[label] = 1e6 * _median(_compiled(*filters), seconds)
    by_model = {}
    for model in MODELS:
        fixed = fixed_count(config.localization, 500, laser_model_type=model)
        part = recording.first(_BEAM_TICKS) if model == "beam" else recording
        by_model[model] = 1e6 * _median(_wrapped(place.grid, fixed, laser, part), seconds)
    return {
        "update_microseconds": wrapped,
        "update_microseconds_compiled": compiled,
        "update_microseconds_by_model": by_model,
    }


def fixed_count(config: LocalizationConfig, count: int, **changes: Any) -> LocalizationConfig:
    """``config`` with exactly ``count`` particles and ``changes``."""
    data = {**config.model_dump(), "min_particles": count, "max_particles": count, **changes}
    return LocalizationConfig.model_validate(data)


def record(config: RunConfig, place: Place) -> SensorLog:
    """The drive that all filters hear: through the configured scenario and its people."""
    return record_drives(place, config.world, drives=1, updates=_TICKS, seed=config.seed)[0]


def used_beams(
    recording: SensorLog, config: LocalizationConfig, laser: LaserConfig
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Ranges (T, n) and bearings (n,) of the beams that a filter of ``config`` is given."""
    stride = amcl_beam_stride(laser, config)
    bearings = beam_bearings(laser)[::stride].astype(np.float32)
    return np.ascontiguousarray(recording.ranges[:, ::stride]), bearings


def _wrapped(
    grid: OccupancyGrid, config: LocalizationConfig, laser: LaserConfig, recording: SensorLog
) -> Callable[[], float]:
    """A replay through ``AMCL``: seconds per update that moved the filter."""
    amcl = AMCL(LikelihoodMap.build(grid, config, laser), config, laser)
    ranges, bearings = used_beams(recording, config, laser)

    def replay() -> float:
        amcl.reset(recording.start, stream_state(1, 0, 0, Stream.LOCALIZATION))
        updates = 0
        started = perf_counter()
        for pose, row in zip(recording.odometry, ranges, strict=True):
            updates += amcl.update(pose, row, bearings)
        return (perf_counter() - started) / updates

    return replay


@kernel()
def _replay(odometry, ranges, bearings, belief, scratch, bins, limits, field, settings):
    updates = 0
    for i in range(odometry.shape[0]):
        updates += update_belief(
            odometry[i], ranges[i], bearings, belief, scratch, bins, limits, field, settings, True
        )
    return updates


def _compiled(
    grid: OccupancyGrid, config: LocalizationConfig, laser: LaserConfig, recording: SensorLog
) -> Callable[[], float]:
    """The same replay in one compiled call."""
    belief = belief_of(make_beliefs(1, config), 0)
    scratch, bins = make_scratch(config, laser), make_bins(config)
    field = LikelihoodMap.build(grid, config, laser)
    amcl = AMCL(field, config, laser, belief, scratch, bins)
    constant = (kld_limits(config), make_field(field), make_settings(config, laser))
    ranges, bearings = used_beams(recording, config, laser)

    def replay() -> float:
        amcl.reset(recording.start, stream_state(1, 0, 0, Stream.LOCALIZATION))
        started = perf_counter()
        updates = _replay(recording.odometry, ranges, bearings, belief, scratch, bins, *constant)
        return (perf_counter() - started) / int(updates)

    return replay


def _median(replay: Callable[[], float], seconds: float) -> float:
    """Median of at least ``REPETITIONS`` replays, after one that warms up."""
    replay()
    times: list[float] = []
    started = perf_counter()
    while len(times) < REPETITIONS or perf_counter() - started < seconds:
        times.append(replay())
    return statistics.median(times)
