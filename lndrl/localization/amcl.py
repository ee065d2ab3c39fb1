"""Adaptive Monte Carlo localization: the robot's belief, one compiled call per update.

The loop is ROS AMCL's: odometry gate, motion, sensor, KLD resampling with recovery, estimate; each
step is a kernel next to its concept. All memory is taken when the filter is made.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.localization.angles import difference
from lndrl.localization.bins import bin_keys, insert, make_bins
from lndrl.localization.clusters import estimate
from lndrl.localization.likelihood import (
    BEAMS_PER_PASS,
    LikelihoodMap,
    beam_ends,
    likelihood_field,
    to_cells,
)
from lndrl.localization.motion import decompose, deviations, draw_noise, move, scatter
from lndrl.localization.resampling import (
    follow_average,
    kld_limits,
    recovery_chance,
    resample,
)
from lndrl.randomness import State

Vector = NDArray[np.float64]

# Places in ``Belief.numbers``.
_COUNT, _CURRENT, _UPDATES, _BAD_ODOMETRY, _BAD_READINGS = range(5)
# An odometer that jumps farther (m) is broken, not moving; it would also overflow the cell index.
_FARTHEST_JUMP = 1000.0


class Belief(NamedTuple):
    """Everything that an update changes and the next one needs; copied, it is a snapshot."""

    particles: Vector  # (2, 5, capacity): two sets of rows x, y, yaw, cos, sin
    weights: Vector  # (capacity,), sum 1
    averages: Vector  # [w_slow, w_fast]
    odometry: Vector  # (3,) reading at the last update
    pose: Vector  # (3,)
    covariance: Vector  # (3, 3)
    numbers: NDArray[np.int64]  # see the places above
    random: State


class Scratch(NamedTuple):
    """Memory that only lives within one update."""

    noise: Vector  # (3, capacity)
    cells: NDArray[np.float32]  # (4, capacity)
    beams: NDArray[np.float32]  # (2, beams)
    indices: NDArray[np.int32]  # (BEAMS_PER_PASS, capacity)
    likelihood: NDArray[np.float32]  # (capacity,)
    cumulative: Vector  # (capacity,)
    guide: NDArray[np.int32]  # (capacity,)
    keys: NDArray[np.int64]  # (capacity,)
    bin_of: NDArray[np.int32]  # (capacity,)


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


class Settings(NamedTuple):
    """The numbers of ``LocalizationConfig`` that compiled code takes."""

    alpha: tuple[float, float, float, float]
    range_max: float
    update_min_d: float
    update_min_a: float
    resample_interval: int
    alpha_slow: float
    alpha_fast: float


class AMCL:
    """Particle filter of one robot.

    Attributes (updated in place; copy what you keep):
      ``pose_estimated`` (3,): mean x, y (m), yaw (rad) of the heaviest cluster, map frame;
      ``covariance`` (3, 3) and ``variance`` (3,) of x, y, yaw over the WHOLE set.
    """

    def __init__(
        self, field: LikelihoodMap, config: LocalizationConfig, laser: LaserConfig
    ) -> None:
        capacity = config.max_particles
        self.pose_estimated: Vector = np.zeros(3)
        self.covariance: Vector = np.zeros((3, 3))
        self._spread = np.array(
            [config.initial_deviation_xy] * 2 + [config.initial_deviation_yaw], dtype=np.float64
        )
        self._belief = Belief(
            particles=np.zeros((2, 5, capacity)),
            weights=np.zeros(capacity),
            averages=np.zeros(2),
            odometry=np.zeros(3),
            pose=self.pose_estimated,
            covariance=self.covariance,
            numbers=np.zeros(5, dtype=np.int64),
            random=np.zeros(4, dtype=np.uint64),
        )
        self._scratch = _make_scratch(capacity, laser.beams)
        self._bins = make_bins(config)
        self._limits = kld_limits(config)
        self._field = _make_field(field)
        self._settings = _make_settings(config, laser)
        self._most_beams = laser.beams

    @property
    def count(self) -> int:
        """Particles in the current set."""
        return int(self._belief.numbers[_COUNT])

    @property
    def particles(self) -> Vector:
        """View ``(count, 3)`` of x, y (m), yaw (rad); valid until the next update."""
        numbers = self._belief.numbers
        view: Vector = self._belief.particles[numbers[_CURRENT], :3, : numbers[_COUNT]].T
        return view

    @property
    def variance(self) -> Vector:
        """View ``(3,)``: variances of x, y (m^2) and yaw (rad^2) of the whole set."""
        return np.diagonal(self.covariance)

    @property
    def ignored_odometry(self) -> int:
        """Updates refused since the reset because the odometry was not finite or jumped > 1 km."""
        return int(self._belief.numbers[_BAD_ODOMETRY])

    @property
    def ignored_readings(self) -> int:
        """Laser readings skipped since the reset because they were not finite."""
        return int(self._belief.numbers[_BAD_READINGS])

    def reset(
        self, pose: ArrayLike, state: State, pose_odometry: ArrayLike = (0.0, 0.0, 0.0)
    ) -> None:
        """Draw ``max_particles`` around ``pose`` (m, m, rad; map frame), as ROS does.

        ``state`` (uint64[4]) seeds the filter's draws and is copied. ``pose_odometry`` is the
        odometer's reading at ``pose``; a world's odometer starts at zero. Raises ValueError for
        poses or states of another shape or that are not finite.
        """
        start = _checked_pose(pose, "pose")
        belief = self._belief
        belief.odometry[:] = _checked_pose(pose_odometry, "pose_odometry")
        if np.shape(state) != (4,):
            raise ValueError("state must be uint64[4], see lndrl.randomness.stream_state")
        belief.random[:] = state
        _reset(start, self._spread, belief, self._scratch, self._bins)

    def update(
        self,
        pose_odometry: Vector,
        ranges: NDArray[np.float32],
        bearings: NDArray[np.float32],
    ) -> bool:
        """Take in an odometry pose (3,) and a scan; False when the gate is closed.

        ``ranges`` (m) and ``bearings`` (rad, robot frame) are ``(n,)``, at most ``laser.beams``.
        The gate opens when |dx| or |dy| exceeds ``update_min_d`` or |dyaw| ``update_min_a`` since
        the last update (per axis, as ROS); closed, nothing changes. Non-finite odometry is ignored
        and counted, non-finite readings are skipped and counted, readings at or beyond
        ``laser_max_range`` skipped. Raises ValueError for shapes that do not fit.
        """
        odometry = np.ascontiguousarray(pose_odometry, dtype=np.float64)
        ranges = np.ascontiguousarray(ranges, dtype=np.float32)
        bearings = np.ascontiguousarray(bearings, dtype=np.float32)
        if odometry.shape != (3,) or ranges.ndim != 1 or ranges.shape != bearings.shape:
            raise ValueError("update needs odometry (3,), and ranges and bearings of one length")
        if ranges.size > self._most_beams:
            raise ValueError(f"{ranges.size} ranges, the laser has {self._most_beams} beams")
        return bool(
            _update(
                odometry,
                ranges,
                bearings,
                self._belief,
                self._scratch,
                self._bins,
                self._limits,
                self._field,
                self._settings,
            )
        )


def amcl_beam_stride(laser: LaserConfig, localization: LocalizationConfig) -> int:
    """Every how many beams the filter uses one, as ROS: 12 of 720 beams for 60."""
    if localization.laser_max_beams == 1:
        return laser.beams
    return max(1, (laser.beams - 1) // (localization.laser_max_beams - 1))


@njit(cache=True, nogil=True, error_model="numpy")
def _reset(start, spread, belief, scratch, bins):
    count = belief.weights.size
    belief.numbers[:] = 0
    belief.numbers[_COUNT] = count
    belief.averages[:] = 0.0
    belief.weights[:] = 1.0 / count
    particles = belief.particles[0]
    scatter(particles, count, start, spread, belief.random)
    k = _fill_bins(particles, count, scratch, bins)
    estimate(
        particles, belief.weights, count, scratch.bin_of, bins, k, belief.pose, belief.covariance
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_bins(particles, count, scratch, bins):
    bin_keys(particles, count, bins, scratch.keys)
    bins.slots[:] = -1
    k = 0
    for i in range(count):
        scratch.bin_of[i], k = insert(scratch.keys[i], bins, k)
    return k


@njit(cache=True, nogil=True, error_model="numpy")
def _gate(new, belief, settings):
    """Whether the odometry pose asks for an update; counts poses that cannot be true."""
    old = belief.odometry
    dx = abs(new[0] - old[0])
    dy = abs(new[1] - old[1])
    # Comparisons with NaN are false, so this refuses NaN and infinity as well.
    if not (dx < _FARTHEST_JUMP and dy < _FARTHEST_JUMP and abs(new[2]) < 1e6):
        belief.numbers[_BAD_ODOMETRY] += 1
        return False
    turn = abs(difference(new[2], old[2]))
    return dx > settings.update_min_d or dy > settings.update_min_d or turn > settings.update_min_a


@njit(cache=True, nogil=True, error_model="numpy")
def _predict(particles, count, new, belief, scratch, settings):
    rotation1, translation, rotation2 = decompose(belief.odometry, new)
    spread = deviations(rotation1, translation, rotation2, settings.alpha)
    draw_noise(scratch.noise, count, spread, belief.random)
    move(particles, count, (rotation1, translation, rotation2), scratch.noise)
    belief.odometry[:] = new


@njit(cache=True, nogil=True, error_model="numpy")
def _weigh(particles, count, ranges, bearings, belief, scratch, field, settings):
    kept, broken = beam_ends(ranges, bearings, settings.range_max, field.resolution, scratch.beams)
    belief.numbers[_BAD_READINGS] += broken
    to_cells(particles, count, field.resolution, field.origin_x, field.origin_y, scratch.cells)
    likelihood_field(
        field.table, field.rows, field.columns, scratch.cells, count,
        scratch.beams, kept, scratch.indices, scratch.likelihood,
    )  # fmt: skip
    total = 0.0
    for i in range(count):
        belief.weights[i] *= scratch.likelihood[i]
        total += belief.weights[i]
    for i in range(count):
        belief.weights[i] /= total
    # The weights summed to 1, so their new sum is the mean likelihood (Thrun's w_avg). ROS divides
    # it by the count once more. That belongs to the behaviour that the paper measured: an episode
    # starts with the most particles, so its slow average starts low, and injection is rare.
    follow_average(belief.averages, total / count, settings.alpha_slow, settings.alpha_fast)


@njit(cache=True, nogil=True, error_model="numpy")
def _update(odometry, ranges, bearings, belief, scratch, bins, limits, field, settings):
    if not _gate(odometry, belief, settings):
        return False
    numbers = belief.numbers
    count = numbers[_COUNT]
    particles = belief.particles[numbers[_CURRENT]]
    _predict(particles, count, odometry, belief, scratch, settings)
    _weigh(particles, count, ranges, bearings, belief, scratch, field, settings)
    numbers[_UPDATES] += 1
    if numbers[_UPDATES] % settings.resample_interval == 0:
        chance = recovery_chance(belief.averages)
        target = belief.particles[1 - numbers[_CURRENT]]
        bin_keys(particles, count, bins, scratch.keys)
        bins.slots[:] = -1
        count, k = resample(
            particles, belief.weights, count, target, scratch,
            bins, limits, chance, field, belief.random,
        )  # fmt: skip
        belief.weights[:count] = 1.0 / count
        numbers[_COUNT] = count
        numbers[_CURRENT] = 1 - numbers[_CURRENT]
        particles = target
    else:
        k = _fill_bins(particles, count, scratch, bins)
    estimate(
        particles, belief.weights, count, scratch.bin_of, bins, k, belief.pose, belief.covariance
    )
    return True


def _make_scratch(capacity: int, beams: int) -> Scratch:
    return Scratch(
        noise=np.zeros((3, capacity)),
        cells=np.zeros((4, capacity), dtype=np.float32),
        beams=np.zeros((2, beams), dtype=np.float32),
        indices=np.zeros((BEAMS_PER_PASS, capacity), dtype=np.int32),
        likelihood=np.zeros(capacity, dtype=np.float32),
        cumulative=np.zeros(capacity),
        guide=np.zeros(capacity, dtype=np.int32),
        keys=np.zeros(capacity, dtype=np.int64),
        bin_of=np.zeros(capacity, dtype=np.int32),
    )


def _make_field(field: LikelihoodMap) -> Field:
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
    )


def _make_settings(config: LocalizationConfig, laser: LaserConfig) -> Settings:
    return Settings(
        alpha=(
            float(config.odom_alpha1),
            float(config.odom_alpha2),
            float(config.odom_alpha3),
            float(config.odom_alpha4),
        ),
        range_max=float(min(config.laser_max_range, laser.range_max)),
        update_min_d=float(config.update_min_d),
        update_min_a=float(config.update_min_a),
        resample_interval=int(config.resample_interval),
        alpha_slow=float(config.recovery_alpha_slow),
        alpha_fast=float(config.recovery_alpha_fast),
    )


def _checked_pose(pose: ArrayLike, name: str) -> Vector:
    array = np.array(pose, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"{name} must be three finite numbers x, y, yaw, not {pose!r}")
    return array
