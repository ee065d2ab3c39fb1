"""What one filter remembers, what all filters of a process share: arrays for compiled kernels.

A belief is a NamedTuple of arrays and nothing else, so a thousand of them are the same NamedTuple
with a leading world dimension, a copy is a snapshot, and kernels of other rooms can hold them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.kernels import kernel
from lndrl.localization.likelihood import BEAMS_PER_PASS, LikelihoodMap
from lndrl.localization.scanner import AT_THE_CENTRE, Scanner
from lndrl.randomness import State

Vector = NDArray[np.float64]

# Places in ``Belief.numbers``.
COUNT, CURRENT, UPDATES, BAD_ODOMETRY, BAD_READINGS, UNPUBLISHED = range(6)
# Places in ``Belief.quality``.
EFFECTIVE_COUNT, BEAM_AGREEMENT = range(2)

LIKELIHOOD_FIELD, LIKELIHOOD_FIELD_PROB, BEAM = range(3)
SENSOR_MODELS = {
    "likelihood_field": LIKELIHOOD_FIELD,
    "likelihood_field_prob": LIKELIHOOD_FIELD_PROB,
    "beam": BEAM,
}


class Belief(NamedTuple):
    """Everything that an update changes and the next one needs; copied, it is a snapshot."""

    particles: Vector  # (2, 5, room_for(capacity)): two sets of rows x, y, yaw, cos, sin
    weights: Vector  # (capacity,), sum 1
    averages: Vector  # [w_slow, w_fast]
    odometry: Vector  # (3,) reading at the last update
    pose: Vector  # (3,)
    covariance: Vector  # (3, 3)
    numbers: NDArray[np.int64]  # see the places above
    random: State
    quality: Vector  # see the places above
    alpha: Vector  # (4,) odom_alpha1 to 4 in this episode


class Scratch(NamedTuple):
    """Memory that only lives within one update; one for all filters of a thread."""

    noise: Vector  # (3, room_for(capacity))
    cells: NDArray[np.float32]  # (4, room_for(capacity))
    beams: NDArray[np.float32]  # (2, beams)
    indices: NDArray[np.int32]  # (BEAMS_PER_PASS, room_for(capacity))
    likelihood: NDArray[np.float32]  # (capacity,)
    cumulative: Vector  # (capacity,)
    guide: NDArray[np.int32]  # (capacity,)
    keys: NDArray[np.int64]  # (capacity,)
    bin_of: NDArray[np.int32]  # (capacity,)
    readings: Vector  # (5, beams), what the beam model prepares per beam


class Field(NamedTuple):
    """A ``LikelihoodMap`` as compiled code takes it."""

    table: NDArray[np.float32]  # flat, padded
    free_cells: NDArray[np.int32]
    width: int
    rows: int
    columns: int
    resolution: float
    origin_x: float
    origin_y: float
    clearance: NDArray[np.uint8]  # (height, width) of the grid, for the beam model
    skip_level: float  # table value at beam_skip_distance: larger is nearer
    agreement_level: float  # table value at agreement_distance

    def __deepcopy__(self, memo: dict[int, Any]) -> Field:
        return self  # never written, and megabytes


class Settings(NamedTuple):
    """The numbers of ``LocalizationConfig`` that compiled code takes."""

    range_max: float
    update_min_d: float
    update_min_a: float
    update_at_start: int  # 1: the first scan after a reset is weighed though nothing has moved
    resample_interval: int
    alpha_slow: float
    alpha_fast: float
    recovery_tolerance: float
    recovery_persistent: int
    sensor_model: int  # see SENSOR_MODELS
    motion_corrected: int  # 1: deviations are square roots of the variances
    systematic: int  # 1: low-variance draws
    selective: int  # 1: resample only when N_eff < N / 2
    beam_skip: int
    beam_skip_threshold: float
    beam_skip_error_threshold: float
    beam_numbers: tuple[float, float, float, float, float, float]
    """z_hit, z_short, z_max, z_rand, sigma_hit (m), lambda_short (1/m)"""
    range_min: float  # m; readings at or below are no echo
    mount_x: float  # m, where the scanner stands in the robot frame
    mount_y: float


@kernel(_nrt=False)
def room_for(count):
    """``count`` rounded up to whole blocks of 32 particles.

    Loops over particles run to there, over leftovers beyond the last one that nobody reads: what
    does not fill a block is done one by one, which took a fifth of an update of 501 particles.
    """
    return (count + 31) // 32 * 32


def make_beliefs(worlds: int, config: LocalizationConfig) -> Belief:
    """Empty beliefs of ``worlds`` filters: every array has a leading world dimension."""
    capacity = config.max_particles
    return Belief(
        particles=np.zeros((worlds, 2, 5, room_for(capacity))),
        weights=np.zeros((worlds, capacity)),
        averages=np.zeros((worlds, 2)),
        odometry=np.zeros((worlds, 3)),
        pose=np.zeros((worlds, 3)),
        covariance=np.zeros((worlds, 3, 3)),
        numbers=np.zeros((worlds, 6), dtype=np.int64),
        random=np.zeros((worlds, 4), dtype=np.uint64),
        quality=np.zeros((worlds, 2)),
        alpha=np.tile(motion_noise(config), (worlds, 1)),
    )


def motion_noise(config: LocalizationConfig) -> Vector:
    """(4,) odom_alpha1 to 4."""
    return np.array([float(getattr(config, f"odom_alpha{k}")) for k in (1, 2, 3, 4)])


def belief_of(beliefs: Belief, world: int) -> Belief:
    """Views of one world's arrays in ``make_beliefs``."""
    return Belief(*(array[world] for array in beliefs))


@njit(inline="always")
def belief_row(beliefs, i):
    """``belief_of`` for kernels."""
    return Belief(
        beliefs.particles[i], beliefs.weights[i], beliefs.averages[i], beliefs.odometry[i],
        beliefs.pose[i], beliefs.covariance[i], beliefs.numbers[i], beliefs.random[i],
        beliefs.quality[i], beliefs.alpha[i],
    )  # fmt: skip


def beam_room(config: LocalizationConfig, laser: LaserConfig) -> int:
    """The most beams that one update uses: those of ``laser``, or of any scan, thinned."""
    return max(laser.beams, 2 * config.laser_max_beams)


def make_scratch(config: LocalizationConfig, laser: LaserConfig) -> Scratch:
    """Working memory for filters of this configuration, at most ``beam_room`` beams."""
    capacity, beams = config.max_particles, beam_room(config, laser)
    return Scratch(
        noise=np.zeros((3, room_for(capacity))),
        cells=np.zeros((4, room_for(capacity)), dtype=np.float32),
        beams=np.zeros((2, beams), dtype=np.float32),
        indices=np.zeros((BEAMS_PER_PASS, room_for(capacity)), dtype=np.int32),
        likelihood=np.zeros(capacity, dtype=np.float32),
        cumulative=np.zeros(capacity),
        guide=np.zeros(capacity, dtype=np.int32),
        keys=np.zeros(capacity, dtype=np.int64),
        bin_of=np.zeros(capacity, dtype=np.int32),
        readings=np.zeros((5, beams)),
    )


def make_field(field: LikelihoodMap) -> Field:
    """The map as kernels take it; the arrays are shared, not copied."""
    rows, columns = field.table.shape
    return Field(
        table=field.table.ravel(),
        free_cells=field.free_cells,
        width=int(field.width),
        rows=int(rows),
        columns=int(columns),
        resolution=float(field.resolution),
        origin_x=float(field.origin[0]),
        origin_y=float(field.origin[1]),
        clearance=field.clearance,
        skip_level=float(field.skip_level),
        agreement_level=float(field.agreement_level),
    )


def make_settings(
    config: LocalizationConfig, laser: LaserConfig, scanner: Scanner = AT_THE_CENTRE
) -> Settings:
    """The configuration as kernels take it, for a scanner that stands where ``scanner`` says."""
    return Settings(
        # Readings are single precision: one without an echo must not fall short of the limit.
        range_max=float(np.float32(config.max_range(laser.range_max))),
        update_min_d=float(config.update_min_d),
        update_min_a=float(config.update_min_a),
        update_at_start=int(config.update_at_start),
        resample_interval=int(config.resample_interval),
        alpha_slow=float(config.recovery_alpha_slow),
        alpha_fast=float(config.recovery_alpha_fast),
        recovery_tolerance=float(config.recovery_tolerance),
        recovery_persistent=int(config.recovery_persistent),
        sensor_model=SENSOR_MODELS[config.laser_model_type],
        motion_corrected=int(config.odom_model_type == "diff-corrected"),
        systematic=int(config.resample_model_type == "systematic"),
        selective=int(config.selective_resampling),
        beam_skip=int(config.do_beamskip),
        beam_skip_threshold=float(config.beam_skip_threshold),
        beam_skip_error_threshold=float(config.beam_skip_error_threshold),
        beam_numbers=(
            float(config.laser_z_hit),
            float(config.laser_z_short),
            float(config.laser_z_max),
            float(config.laser_z_rand),
            float(config.laser_sigma_hit),
            float(config.laser_lambda_short),
        ),
        # As above: what a driver writes for no echo must not lie above the limit.
        range_min=float(np.float32(config.min_range(scanner.range_min))),
        mount_x=float(scanner.x),
        mount_y=float(scanner.y),
    )
