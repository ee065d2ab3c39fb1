"""One step of the filter as compiled code: gate, motion, sensor, resampling, estimate.

Kernels for one world's ``Belief``, callable from other kernels; ``amcl.AMCL`` wraps them. Each step
is a kernel next to its concept; which model runs is a number in ``Settings``, asked once per
update, so all configurations share one compiled signature.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from lndrl.kernels import kernel
from lndrl.localization.angles import difference
from lndrl.localization.beam_model import beam_model, prepare_readings
from lndrl.localization.belief import (
    BAD_ODOMETRY,
    BAD_READINGS,
    BEAM,
    BEAM_AGREEMENT,
    COUNT,
    CURRENT,
    EFFECTIVE_COUNT,
    LIKELIHOOD_FIELD_PROB,
    UNPUBLISHED,
    UPDATES,
    Belief,
    Field,
    Scratch,
    Settings,
    room_for,
)
from lndrl.localization.bins import Bins, bin_keys, empty, insert
from lndrl.localization.clusters import estimate
from lndrl.localization.confidence import beam_agreement, effective_count
from lndrl.localization.field_prob import converged, skip_beams, weigh_logarithms
from lndrl.localization.likelihood import beam_ends, likelihood_field, to_cells
from lndrl.localization.motion import decompose, deviations, draw_noise, move, scatter
from lndrl.localization.recovery import injection_chance
from lndrl.localization.resampling import follow_average, inject, resample
from lndrl.localization.systematic import resample_systematic

# An odometer that jumps farther (m) is broken, not moving; it would also overflow the cell index.
_FARTHEST_JUMP = 1000.0


@kernel(_nrt=False, error_model="numpy")
def _begin(belief):
    """A full set of equal weights, nothing remembered; returns its size."""
    count = min(belief.weights.size, belief.particles.shape[2])
    belief.numbers[:] = 0
    belief.numbers[COUNT] = count
    belief.averages[:] = 0.0
    belief.weights[:] = 1.0 / count
    belief.quality[EFFECTIVE_COUNT] = count
    belief.quality[BEAM_AGREEMENT] = 0.0
    return count


@kernel(_nrt=False, error_model="numpy")
def reset_belief(start, spread, belief, scratch, bins):
    """Draw the full set around ``start`` [x, y, yaw] with deviations ``spread`` (m, m, rad).

    The caller sets ``belief.random`` (the seed) and ``belief.odometry`` (the reading at ``start``).
    """
    count = _begin(belief)
    particles = belief.particles[0]
    scatter(particles, count, start, spread, belief.random)
    summarise(belief, scratch, bins)


@kernel(_nrt=False, error_model="numpy")
def spread_belief(belief, scratch, bins, field):
    """Draw the full set uniformly over the free cells and all headings."""
    count = _begin(belief)
    for i in range(count):
        inject(belief.particles[0], i, field, belief.random)
    summarise(belief, scratch, bins)


@njit(inline="always")
def fits(belief, scratch, bins):
    """Whether there is a set, and room to work on it: not before the first reset."""
    numbers = belief.numbers
    room = min(belief.weights.size, scratch.keys.size, bins.key.size)
    return 0 < numbers[COUNT] <= room and 0 <= numbers[CURRENT] <= 1


@kernel(_nrt=False, error_model="numpy")
def summarise(belief, scratch, bins):
    """Estimate and covariance of the current set as it is."""
    count = belief.numbers[COUNT]
    if not fits(belief, scratch, bins):
        return
    particles = belief.particles[belief.numbers[CURRENT]]
    k = fill_bins(particles, count, scratch, bins)
    estimate(
        particles, belief.weights, count, scratch.bin_of, bins, k, belief.pose, belief.covariance
    )


@kernel(_nrt=False, error_model="numpy")
def fill_bins(particles, count, scratch, bins):
    """Sort ``count`` particles into emptied ``bins``; returns the number of occupied ones."""
    bin_keys(particles, count, bins, scratch.keys)
    empty(bins)
    k = 0
    for i in range(count):
        scratch.bin_of[i], k = insert(scratch.keys[i], bins, k)
    return k


@kernel(_nrt=False, error_model="numpy")
def _gate(new, belief, settings):
    """Whether the odometry pose asks for an update; counts poses that cannot be true."""
    if not _credible(new, belief):
        belief.numbers[BAD_ODOMETRY] += 1
        return False
    if settings.update_at_start != 0 and belief.numbers[UPDATES] == 0:
        return True
    return _moved(new, belief, settings)


@kernel(_nrt=False, error_model="numpy")
def _credible(new, belief):
    """Whether a robot can have come to ``new`` since the last update."""
    dx = abs(new[0] - belief.odometry[0])
    dy = abs(new[1] - belief.odometry[1])
    # Comparisons with NaN are false, so this refuses NaN and infinity as well.
    return dx < _FARTHEST_JUMP and dy < _FARTHEST_JUMP and abs(new[2]) < 1e6


@kernel(_nrt=False, error_model="numpy")
def _moved(new, belief, settings):
    """Whether a credible pose is farther from the last one than the gate's thresholds."""
    if not _credible(new, belief):
        return False
    old = belief.odometry
    dx = abs(new[0] - old[0])
    dy = abs(new[1] - old[1])
    turn = abs(difference(new[2], old[2]))
    return dx > settings.update_min_d or dy > settings.update_min_d or turn > settings.update_min_a


@kernel(_nrt=False, error_model="numpy")
def _predict(particles, count, new, belief, scratch, settings):
    rotation1, translation, rotation2 = decompose(belief.odometry, new)
    spread = deviations(rotation1, translation, rotation2, belief.alpha)
    if settings.motion_corrected != 0:
        spread = (math.sqrt(spread[0]), math.sqrt(spread[1]), math.sqrt(spread[2]))
    room = room_for(count)
    # A row of the sensor model, whose turn comes later, holds what is drawn.
    draw_noise(scratch.noise, room, spread, belief.random, scratch.cells[0])
    move(particles, room, (rotation1, translation, rotation2), scratch.noise)
    for k in range(3):
        belief.odometry[k] = new[k]


@kernel(_nrt=False, error_model="numpy")
def _weigh_sums(weights, likelihood, count):
    """Multiply ``weights`` by the likelihoods and normalise them; returns their sum before."""
    total = 0.0
    for i in range(count):
        weights[i] *= likelihood[i]
        total += weights[i]
    for i in range(count):
        weights[i] /= total
    # The weights summed to 1, so their new sum is the mean likelihood (Thrun's w_avg). ROS divides
    # it by the count once more. That belongs to the behaviour that the paper measured: an episode
    # starts with the most particles, so its slow average starts low, and injection is rare.
    return total / count


@kernel(_nrt=False, error_model="numpy")
def _weigh(particles, count, ranges, bearings, belief, scratch, field, settings):
    """Weigh by the scan; returns the number of beams with an echo, all in ``scratch.beams``."""
    kept, broken = beam_ends(
        ranges, bearings, settings.range_max, field.resolution, scratch.beams,
        settings.range_min, settings.mount_x, settings.mount_y,
    )  # fmt: skip
    belief.numbers[BAD_READINGS] += broken
    used = kept
    if settings.sensor_model == BEAM:
        beams = prepare_readings(
            ranges, bearings, settings.range_max, settings.beam_numbers, scratch.readings,
            settings.range_min,
        )  # fmt: skip
        beam_model(
            particles, count, scratch.readings, beams, field,
            settings.range_max, settings.beam_numbers, scratch.likelihood,
            settings.mount_x, settings.mount_y,
        )  # fmt: skip
    else:
        to_cells(
            particles, room_for(count), field.resolution, field.origin_x, field.origin_y,
            scratch.cells,
        )  # fmt: skip
        if settings.beam_skip != 0 and converged(particles, count):
            used = skip_beams(
                field, scratch.cells, count, scratch.beams, kept,
                settings.beam_skip_threshold, settings.beam_skip_error_threshold,
            )  # fmt: skip
        likelihood_field(
            field.table, field.rows, field.columns, scratch.cells, count,
            scratch.beams, used, scratch.indices, scratch.likelihood,
        )  # fmt: skip
    if settings.sensor_model == LIKELIHOOD_FIELD_PROB:
        average = weigh_logarithms(belief.weights, scratch.likelihood, count, used)
    else:
        average = _weigh_sums(belief.weights, scratch.likelihood, count)
    if used > 0 or settings.sensor_model != LIKELIHOOD_FIELD_PROB:
        # A product over no beams says nothing about how well the scan fits.
        follow_average(belief.averages, average, settings.alpha_slow, settings.alpha_fast)
    belief.quality[EFFECTIVE_COUNT] = effective_count(belief.weights, count)
    return kept


@kernel(_nrt=False, error_model="numpy")
def _resample(particles, count, belief, scratch, bins, limits, field, settings):
    """Draw the other set from this one; returns its size and number of occupied bins."""
    chance = injection_chance(
        belief.averages, settings.recovery_tolerance, settings.recovery_persistent
    )
    target = belief.particles[1 - belief.numbers[CURRENT]]
    bin_keys(particles, count, bins, scratch.keys)
    empty(bins)
    if settings.systematic != 0:
        count, k = resample_systematic(
            particles, belief.weights, count, target, scratch,
            bins, limits, chance, field, belief.random,
        )  # fmt: skip
    else:
        count, k = resample(
            particles, belief.weights, count, target, scratch,
            bins, limits, chance, field, belief.random,
        )  # fmt: skip
    belief.weights[:count] = 1.0 / count
    belief.numbers[COUNT] = count
    belief.numbers[CURRENT] = 1 - belief.numbers[CURRENT]
    return count, k


@kernel(_nrt=False, error_model="numpy")
def update_belief(
    odometry, ranges, bearings, belief, scratch, bins, limits, field, settings, publish
):
    """Take in an odometry pose (3,) and a scan (float32, (n,) each).

    False at a closed gate, and for a belief that was never reset.

    Where ``publish`` is false pose, covariance and beam agreement stay as they are until a call
    where it is true: who takes four updates and looks once need not pay for four estimates.
    """
    numbers = belief.numbers
    if not fits(belief, scratch, bins):
        return False
    if not _gate(odometry, belief, settings):
        if publish and numbers[UNPUBLISHED] != 0:
            numbers[UNPUBLISHED] = 0
            summarise(belief, scratch, bins)
        return False
    count = numbers[COUNT]
    particles = belief.particles[numbers[CURRENT]]
    _predict(particles, count, odometry, belief, scratch, settings)
    kept = _weigh(particles, count, ranges, bearings, belief, scratch, field, settings)
    numbers[UPDATES] += 1
    due = settings.selective == 0 or belief.quality[EFFECTIVE_COUNT] < 0.5 * count
    if due and numbers[UPDATES] % settings.resample_interval == 0:
        count, k = _resample(particles, count, belief, scratch, bins, limits, field, settings)
        particles = belief.particles[numbers[CURRENT]]
    else:
        k = fill_bins(particles, count, scratch, bins)
    numbers[UNPUBLISHED] = 1
    if publish:
        numbers[UNPUBLISHED] = 0
        estimate(
            particles, belief.weights, count, scratch.bin_of, bins, k,
            belief.pose, belief.covariance,
        )  # fmt: skip
        belief.quality[BEAM_AGREEMENT] = beam_agreement(scratch.beams, kept, belief.pose, field)
    return True


@kernel(_nrt=False, error_model="numpy")
def predict_belief(odometry, belief, scratch, bins, settings):
    """Move by an odometry pose (3,) alone: the cloud drifts and widens as the model says.

    False, and nothing changed, at a closed gate and for a belief that was never reset. Weights
    and the averages that recovery looks at stay as they are.
    """
    if not fits(belief, scratch, bins) or not _moved(odometry, belief, settings):
        return False
    numbers = belief.numbers
    particles = belief.particles[numbers[CURRENT]]
    _predict(particles, numbers[COUNT], odometry, belief, scratch, settings)
    summarise(belief, scratch, bins)
    return True


@kernel(error_model="numpy")
def predict_packed(odometry, everything):
    """``predict_belief`` for callers from Python, with ``pack``'s result."""
    belief, scratch, bins, _, _, settings = everything
    return predict_belief(
        odometry, Belief(*belief), Scratch(*scratch), Bins(*bins), Settings(*settings)
    )


@kernel(error_model="numpy")
def update_packed(odometry, ranges, bearings, everything):
    """``update_belief`` for callers from Python, with ``pack``'s result.

    numba looks at every NamedTuple of a call for about 4 us, at nested plain tuples for 4 in all.
    """
    belief, scratch, bins, limits, field, settings = everything
    return update_belief(
        odometry, ranges, bearings, Belief(*belief), Scratch(*scratch), Bins(*bins), limits,
        Field(*field), Settings(*settings), True,
    )  # fmt: skip


def pack(*arguments: Any) -> tuple[Any, ...]:
    """NamedTuples to plain tuples: belief, scratch, bins, limits, field, settings."""
    return tuple(tuple(a) if isinstance(a, tuple) else a for a in arguments)
