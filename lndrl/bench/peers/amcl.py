"""PyPI ``amcl`` beside our filter: one drive, the same beams, time and accuracy.

That package wraps nav2's C core. It has the beam model only, a fixed KLD bound and no update
gate, and reports the mean of the whole set. Its map lies half a cell off, which is corrected here.
"""

from __future__ import annotations

import importlib
import statistics
from time import perf_counter
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.bench.amcl import fixed_count, record, used_beams
from lndrl.bench.scene import hybrid_config
from lndrl.config import LaserConfig, LocalizationConfig, RunConfig
from lndrl.evaluation.localization.drives import SensorLog
from lndrl.localization import AMCL, LikelihoodMap
from lndrl.maps.grid import OccupancyGrid
from lndrl.randomness import Stream, stream_state
from lndrl.world import Place

PEER = "amcl (PyPI, nav2)"
COUNTS = (500, 2000)
_TICKS = 100
BEAM_MODEL = {
    "laser_model_type": "beam",
    "laser_z_hit": 0.5,
    "laser_z_short": 0.05,
    "laser_z_max": 0.05,
    "laser_z_rand": 0.5,
}
"""nav2's weights; the same for both packages."""


def measure_peers(seconds: float) -> dict[str, Any]:
    """``update_microseconds`` and ``position_rmse`` (m) by ``PARTICLESxBEAMS`` of the package, of
    our beam model (same parameters), likelihood field (the paper's) and ``best``.

    The drive is ``bench amcl``'s first half, with 60 beams.
    """
    config = hybrid_config()
    place = Place.build(config.scenario, config.world.robot_radius)
    recording = record(config, place).first(_TICKS)
    ours = {
        "lndrl beam": LocalizationConfig.model_validate(BEAM_MODEL),
        "lndrl likelihood_field": LocalizationConfig(),
        "lndrl best": LocalizationConfig.model_validate("best"),
    }
    figures: dict[str, Any] = {PEER: _peer(config, place, recording)}
    for name, localization in ours.items():
        rows = {
            f"{count}x60": _ours(place, fixed_count(localization, count), config, recording)
            for count in COUNTS
        }
        figures[name] = _by_key(rows)
    return figures


def _by_key(rows: dict[str, tuple[float, float]]) -> dict[str, Any]:
    return {
        "update_microseconds": {label: 1e6 * seconds for label, (seconds, _) in rows.items()},
        "position_rmse": {label: rmse for label, (_, rmse) in rows.items()},
    }


def _peer(config: RunConfig, place: Place, recording: SensorLog) -> dict[str, Any]:
    try:
        package = importlib.import_module("amcl")
    except ImportError:
        return {"missing": "pip install amcl"}
    rows = {}
    for count in COUNTS:
        localization = fixed_count(LocalizationConfig.model_validate(BEAM_MODEL), count)
        times, estimates = replay_peer(
            package, place.grid, localization, config.world.laser, recording
        )
        rows[f"{count}x60"] = (statistics.median(times), _rmse(estimates, recording))
    return _by_key(rows)


def replay_peer(
    package: ModuleType,
    grid: OccupancyGrid,
    config: LocalizationConfig,
    laser: LaserConfig,
    recording: SensorLog,
) -> tuple[list[float], NDArray[np.float64]]:
    """Seconds of every update of the ``amcl`` package, and its estimates (T, 3) (m, rad).

    Building its scan object from lists is not timed.
    """
    ranges, bearings = used_beams(recording, config, laser)
    peer = _make_peer(package, grid, config, ranges.shape[1])
    deviations = np.square(config.initial_deviations)
    peer.set_initial_pose(
        package.Vector3D(*map(float, recording.start)),
        package.create_diagonal_covariance(*map(float, deviations)),
    )
    times, estimates = [], []
    for odometry, row in zip(recording.odometry, ranges, strict=True):
        pairs = np.column_stack([row, bearings]).astype(float).tolist()
        scan = package.create_laser_scan_from_list(pairs, laser.range_max)
        pose = package.Vector3D(*map(float, odometry))
        started = perf_counter()
        peer.update(scan, pose)
        times.append(perf_counter() - started)
        mean = peer.get_pose_mean()
        estimates.append((mean.x, mean.y, mean.theta))
    return times, np.array(estimates)


def _make_peer(
    package: ModuleType, grid: OccupancyGrid, config: LocalizationConfig, beams: int
) -> Any:
    rows, columns = grid.shape
    half = 0.5 * grid.resolution
    theirs = package.OccupancyGrid(
        columns, rows, grid.resolution, grid.origin[0] + half, grid.origin[1] + half
    )
    theirs.set_from_list((100 * grid.occupied.astype(int)).tolist())
    alphas = (config.odom_alpha1, config.odom_alpha2, config.odom_alpha3, config.odom_alpha4)
    peer = package.AMCL(
        config.min_particles,
        config.max_particles,
        0.0,
        0.0,
        package.MotionParameters(*alphas, 0.0),
        package.LaserParameters(
            config.laser_z_hit,
            config.laser_z_short,
            config.laser_z_max,
            config.laser_z_rand,
            config.laser_sigma_hit,
            config.laser_lambda_short,
            0.0,
            beams,
        ),
        "differential",
    )
    peer.set_map(theirs)
    peer.set_laser_pose(package.Vector3D(0.0, 0.0, 0.0))
    return peer


def _ours(
    place: Place, localization: LocalizationConfig, config: RunConfig, recording: SensorLog
) -> tuple[float, float]:
    """Median seconds of an update, and the position RMSE (m)."""
    laser = config.world.laser
    amcl = AMCL(LikelihoodMap.build(place.grid, localization, laser), localization, laser)
    ranges, bearings = used_beams(recording, localization, laser)
    amcl.reset(recording.start, stream_state(0))
    amcl.update(recording.odometry[0], ranges[0], bearings)  # compiles
    amcl.reset(recording.start, stream_state(config.seed, 0, 0, Stream.LOCALIZATION))
    times, estimates = [], []
    for odometry, row in zip(recording.odometry, ranges, strict=True):
        started = perf_counter()
        amcl.update(odometry, row, bearings)
        times.append(perf_counter() - started)
        estimates.append(amcl.pose_estimated.copy())
    return statistics.median(times), _rmse(np.array(estimates), recording)


def _rmse(estimates: NDArray[np.float64], recording: SensorLog) -> float:
    wrong = estimates[:, :2] - recording.truth[:, :2]
    return float(np.sqrt((wrong**2).sum(axis=1).mean()))
