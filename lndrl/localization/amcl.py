"""Adaptive Monte Carlo localization: the robot's belief, one compiled call per update.

The loop is ROS AMCL's: odometry gate, motion, sensor, KLD resampling with recovery, estimate (see
``update``). All memory is taken when the filter is made, or handed in by who runs many of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.localization.belief import (
    BAD_ODOMETRY,
    BAD_READINGS,
    BEAM_AGREEMENT,
    COUNT,
    CURRENT,
    EFFECTIVE_COUNT,
    Belief,
    Scratch,
    Vector,
    beam_room,
    belief_of,
    make_beliefs,
    make_field,
    make_scratch,
    make_settings,
)
from lndrl.localization.bins import Bins, make_bins
from lndrl.localization.clusters import two_heaviest, two_places
from lndrl.localization.confidence import cluster_spread
from lndrl.localization.likelihood import LikelihoodMap
from lndrl.localization.motion import scatter_correlated
from lndrl.localization.resampling import kld_limits
from lndrl.localization.scanner import AT_THE_CENTRE, Scanner
from lndrl.localization.update import (
    fill_bins,
    pack,
    predict_packed,
    reset_belief,
    spread_belief,
    summarise,
    update_packed,
)
from lndrl.randomness import State


class AMCL:
    """Particle filter of one robot.

    ``belief`` is this filter's row of ``make_beliefs``; ``scratch`` and ``bins`` may be shared by
    all filters of a thread. What is not given is allocated. ``field`` must have been built for the
    same configuration. Raises ValueError for a field, a belief or working memory of another one.
    A copy has memory of its own.

    Attributes (updated in place; copy what you keep):
      ``pose_estimated`` (3,): mean x, y (m), yaw (rad) of the heaviest cluster, map frame;
      ``covariance`` (3, 3) and ``variance`` (3,) of x, y, yaw over the WHOLE set.
    """

    def __init__(
        self,
        field: LikelihoodMap,
        config: LocalizationConfig,
        laser: LaserConfig,
        belief: Belief | None = None,
        scratch: Scratch | None = None,
        bins: Bins | None = None,
        scanner: Scanner = AT_THE_CENTRE,
    ) -> None:
        self._belief = belief_of(make_beliefs(1, config), 0) if belief is None else belief
        self._scratch = make_scratch(config, laser) if scratch is None else scratch
        self._bins = make_bins(config) if bins is None else bins
        self._made_of = (field, config, laser)
        self._scanner = scanner
        if field.model != config.laser_model_type:
            raise ValueError(f"the map was built for {field.model}, not {config.laser_model_type}")
        if field.range_max != config.max_range(laser.range_max):
            raise ValueError(
                f"the map was built for readings below {field.range_max:g} m, not "
                f"{config.max_range(laser.range_max):g} m"
            )
        if self._belief.weights.shape != (config.max_particles,):
            raise ValueError(f"the belief has no room for exactly {config.max_particles} particles")
        if self._scratch.keys.size < config.max_particles or len(
            self._scratch.beams[0]
        ) < beam_room(config, laser):
            raise ValueError("the working memory is for fewer particles or beams")
        if self._bins.key.size < config.max_particles:
            raise ValueError(f"the bins have no room for {config.max_particles} particles")
        self.pose_estimated: Vector = self._belief.pose
        self.covariance: Vector = self._belief.covariance
        self.variance: Vector = np.diagonal(self.covariance)
        self._spread: Vector = np.array(config.initial_deviations)
        self._field = make_field(field)
        self._packed = pack(
            self._belief,
            self._scratch,
            self._bins,
            kld_limits(config),
            self._field,
            make_settings(config, laser, scanner),
        )
        self._max_beams = config.laser_max_beams

    def __reduce__(self) -> tuple[Any, ...]:
        # Built again around the copied memory: variance is a view of the covariance.
        return type(self), (*self._made_of, self._belief, self._scratch, self._bins, self._scanner)

    @property
    def count(self) -> int:
        """Particles in the current set."""
        return int(self._belief.numbers[COUNT])

    @property
    def particles(self) -> Vector:
        """View ``(count, 3)`` of x, y (m), yaw (rad); valid until the next update."""
        numbers = self._belief.numbers
        view: Vector = self._belief.particles[numbers[CURRENT], :3, : numbers[COUNT]].T
        return view

    @property
    def weights(self) -> Vector:
        """View ``(count,)`` of the particles' weights, sum 1; valid until the next update."""
        return self._belief.weights[: self.count]

    @property
    def ignored_odometry(self) -> int:
        """Updates refused since the reset because the odometry was not finite or jumped > 1 km."""
        return int(self._belief.numbers[BAD_ODOMETRY])

    @property
    def ignored_readings(self) -> int:
        """Laser readings skipped since the reset because they were not finite."""
        return int(self._belief.numbers[BAD_READINGS])

    @property
    def effective_count(self) -> float:
        """``1 / sum w^2`` at the last update, before resampling: particles that still matter."""
        return float(self._belief.quality[EFFECTIVE_COUNT])

    @property
    def beam_agreement(self) -> float:
        """Share of the last scan's echoes that the map explains within ``agreement_distance`` of
        an obstacle when seen from ``pose_estimated``; 0 before the first update.
        """
        return float(self._belief.quality[BEAM_AGREEMENT])

    @property
    def cluster_covariance(self) -> Vector:
        """Covariance ``(3, 3)`` of the heaviest cluster alone; computed when asked for."""
        return self._cluster()[0]

    @property
    def cluster_weight(self) -> float:
        """Share of the weight that the heaviest cluster holds; computed when asked for."""
        return self._cluster()[1]

    @property
    def averages(self) -> Vector:
        """View ``(2,)`` of the slow and the fast average of how well scans fit (Thrun's w_slow,
        w_fast); random particles come when the second falls below the first. Both are 0 before the
        first update and, by ROS's rule, after an update that injected.
        """
        return self._belief.averages

    def cluster_masses(self) -> tuple[float, float]:
        """Shares of the weight in the heaviest and the second heaviest cluster as they are now; 0
        where there is none. Changes nothing that an update reads.
        """
        belief, numbers = self._belief, self._belief.numbers
        count = numbers[COUNT]
        k = fill_bins(belief.particles[numbers[CURRENT]], count, self._scratch, self._bins)
        masses = np.zeros(2)
        two_heaviest(belief.weights, count, self._scratch.bin_of, self._bins, k, masses)
        return float(masses[0]), float(masses[1])

    def cluster_places(self) -> Vector:
        """Share of the weight and mean x, y (m) of the two heaviest clusters, (2, 3), the heaviest
        first; zeros where there is none. Changes nothing that an update reads.
        """
        belief, numbers = self._belief, self._belief.numbers
        count, particles = numbers[COUNT], belief.particles[numbers[CURRENT]]
        k = fill_bins(particles, count, self._scratch, self._bins)
        places = np.zeros((2, 3))
        two_places(particles, belief.weights, count, self._scratch.bin_of, self._bins, k, places)
        return places

    def _cluster(self) -> tuple[Vector, float]:
        belief, numbers = self._belief, self._belief.numbers
        count, particles = numbers[COUNT], belief.particles[numbers[CURRENT]]
        k = fill_bins(particles, count, self._scratch, self._bins)
        covariance = np.zeros((3, 3))
        weight = cluster_spread(
            particles, belief.weights, count, self._scratch.bin_of, self._bins, k, covariance
        )
        return covariance, float(weight)

    def reset(
        self,
        pose: ArrayLike,
        state: State,
        pose_odometry: ArrayLike = (0.0, 0.0, 0.0),
        covariance: ArrayLike | None = None,
    ) -> None:
        """Draw ``max_particles`` around ``pose`` (m, m, rad; map frame), as ROS does.

        ``state`` (uint64[4]) seeds the filter's draws and is copied. ``pose_odometry`` is the
        odometer's reading at ``pose``; a world's odometer starts at zero. ``covariance`` (3, 3) of
        x, y, yaw replaces the configured deviations. Raises ValueError for poses, states or
        covariances of another shape, not finite, or negative.
        """
        start = _checked_pose(pose, "pose")
        odometry = _checked_pose(pose_odometry, "pose_odometry")
        root = None if covariance is None else _root(covariance)
        self._seed(state)
        belief = self._belief
        belief.odometry[:] = odometry
        reset_belief(start, self._spread, belief, self._scratch, self._bins)
        if root is not None:
            belief.random[:] = state
            scatter_correlated(belief.particles[0], self.count, start, root, belief.random)
            summarise(belief, self._scratch, self._bins)

    def global_localization(
        self, state: State | None = None, pose_odometry: ArrayLike | None = None
    ) -> None:
        """Forget the pose: draw ``max_particles`` uniformly over the free space, any heading.

        A building needs thousands of particles, and weights that are not too sharp for the nearest
        of them: e.g. ``best`` with ``laser_likelihood_exponent`` 0.1 and ``laser_sigma_hit`` 0.2.
        Goes on with the filter's own draws unless ``state`` (uint64[4]) is given, and compares the
        next odometry with the last one heard unless ``pose_odometry`` is given. Raises ValueError
        as ``reset`` does.
        """
        if pose_odometry is not None:
            self._belief.odometry[:] = _checked_pose(pose_odometry, "pose_odometry")
        if state is not None:
            self._seed(state)
        elif not self._belief.random.any():
            raise ValueError("a filter that was never reset needs a state to draw from")
        spread_belief(self._belief, self._scratch, self._bins, self._field)

    def snapshot(self) -> Belief:
        """Copy of the whole filter; after ``restore`` it goes on bit for bit the same."""
        return Belief._make(array.copy() for array in self._belief)

    def restore(self, snapshot: Belief) -> None:
        """Take up a ``snapshot`` of a filter with the same configuration.

        Raises ValueError when it holds another number of particles.
        """
        if any(a.shape != b.shape for a, b in zip(self._belief, snapshot, strict=True)):
            raise ValueError(
                f"the snapshot has {snapshot.weights.size} particles at most, "
                f"this filter {self._belief.weights.size}"
            )
        for mine, saved in zip(self._belief, snapshot, strict=True):
            mine[...] = saved

    def update(
        self,
        pose_odometry: Vector,
        ranges: NDArray[np.float32],
        bearings: NDArray[np.float32],
    ) -> bool:
        """Take in an odometry pose (3,) and a scan; False when the gate is closed.

        ``ranges`` (m) and ``bearings`` (rad, robot frame) are ``(n,)``, as many as the scanner has;
        of more than ``laser_max_beams`` every so many are used, as ``beam_stride`` says. The gate
        opens when |dx| or |dy| exceeds ``update_min_d`` or |dyaw| ``update_min_a`` since the last
        update (per axis, as ROS); closed, nothing changes. Non-finite odometry is ignored and
        counted, non-finite readings are skipped and counted, readings at or beyond
        ``laser_max_range`` or at or below ``laser_min_range`` skipped (the beam model takes them as
        missed echoes). Raises ValueError for shapes that do not fit, and for a filter that was
        never reset.
        """
        if self.count == 0:
            raise ValueError("a filter that was never reset has no pose; call reset first")
        odometry = np.ascontiguousarray(pose_odometry, dtype=np.float64)
        ranges = np.ascontiguousarray(ranges, dtype=np.float32)
        bearings = np.ascontiguousarray(bearings, dtype=np.float32)
        if odometry.shape != (3,) or ranges.ndim != 1 or ranges.shape != bearings.shape:
            raise ValueError("update needs odometry (3,), and ranges and bearings of one length")
        stride = beam_stride(ranges.size, self._max_beams)
        if stride > 1:
            ranges = np.ascontiguousarray(ranges[::stride])
            bearings = np.ascontiguousarray(bearings[::stride])
        return bool(update_packed(odometry, ranges, bearings, self._packed))

    def predict(self, pose_odometry: Vector) -> bool:
        """Move the cloud by an odometry pose (3,) without a scan; False when the gate is closed.

        For when no usable scan comes: the estimate follows the wheels and its covariance grows.
        Raises ValueError for another shape, and for a filter that was never reset.
        """
        if self.count == 0:
            raise ValueError("a filter that was never reset has no pose; call reset first")
        odometry = np.ascontiguousarray(pose_odometry, dtype=np.float64)
        if odometry.shape != (3,):
            raise ValueError("predict needs odometry (3,)")
        return bool(predict_packed(odometry, self._packed))

    def _seed(self, state: State) -> None:
        if np.shape(state) != (4,):
            raise ValueError("state must be uint64[4], see lndrl.randomness.stream_state")
        self._belief.random[:] = state


def amcl_beam_stride(laser: LaserConfig, localization: LocalizationConfig) -> int:
    """Every how many beams of ``laser`` the filter uses one, as ROS: 12 of 720 beams for 60."""
    return beam_stride(laser.beams, localization.laser_max_beams)


def beam_stride(beams: int, most: int) -> int:
    """Every how many of ``beams`` is used so that about ``most`` are, fewer than twice as many.

    What was thinned by it once is not thinned again.
    """
    if most == 1:
        return max(1, beams)
    return max(1, (beams - 1) // (most - 1))


def _checked_pose(pose: ArrayLike, name: str) -> Vector:
    array = np.array(pose, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"{name} must be three finite numbers x, y, yaw, not {pose!r}")
    return array


def _root(covariance: ArrayLike) -> Vector:
    """Symmetric square root of a covariance; eigenvalues may be zero, not negative."""
    array = np.array(covariance, dtype=np.float64)
    if array.shape != (3, 3) or not np.isfinite(array).all() or not np.allclose(array, array.T):
        raise ValueError("covariance must be a finite symmetric (3, 3) of x, y, yaw")
    values, vectors = np.linalg.eigh(array)
    if values.min() < -1e-9 * max(values.max(), 1e-300):
        raise ValueError("covariance must not have negative eigenvalues")
    root: Vector = np.ascontiguousarray((vectors * np.sqrt(values.clip(0.0))) @ vectors.T)
    return root
