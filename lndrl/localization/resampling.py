"""KLD-adaptive resampling with random recovery (Thrun et al. tables 4.4 and 8.3, as in ROS).

Draws are independent, as ROS's are: a sorted (systematic) sweep would show the KLD rule one corner
of the set after the other. The inverse of the cumulative weights is found through a guide table in
constant expected time, so a resampling is O(N); ROS scans linearly for every draw, O(N^2).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.config import LocalizationConfig
from lndrl.kernels import kernel
from lndrl.localization.bins import bin_key, insert
from lndrl.localization.motion import set_heading
from lndrl.randomness import fill_uniforms, uniform

_BLOCK = 512  # particles drawn at a time; the usual set in one


def kld_limits(config: LocalizationConfig) -> NDArray[np.int32]:
    """Particles that suffice for k occupied bins, int32 ``(max_particles + 1,)``, k from 0 up.

    Fox's bound with the Wilson-Hilferty quantile, kept between ``min_particles`` and
    ``max_particles``. While all particles share one bin the bound says nothing, and
    ``kld_one_bin`` decides: ROS asks for the maximum then (``pf_resample_limit``). A tight cloud
    that crosses a border between bins so flips between the two sizes.
    """
    limits = np.full(config.max_particles + 1, config.min_particles, dtype=np.int32)
    if config.kld_one_bin == "max":
        limits[:2] = config.max_particles
    for k in range(2, config.max_particles + 1):
        spread = 2.0 / (9.0 * (k - 1))
        quantile = (1.0 - spread + math.sqrt(spread) * config.kld_quantile) ** 3
        needed = math.ceil((k - 1) / (2.0 * config.kld_err) * quantile)
        limits[k] = min(max(needed, config.min_particles), config.max_particles)
    return limits


@kernel(_nrt=False, error_model="numpy")
def follow_average(averages, average, alpha_slow, alpha_fast):
    """Advance ``averages`` = [w_slow, w_fast] in place by the mean likelihood ``average``."""
    for i, alpha in ((0, alpha_slow), (1, alpha_fast)):
        if averages[i] == 0.0:
            averages[i] = average
        else:
            averages[i] += alpha * (average - averages[i])


@kernel(_nrt=False, error_model="numpy")
def recovery_chance(averages):
    """Chance that a drawn particle is random: ``max(0, 1 - w_fast / w_slow)``.

    Both averages are cleared when it is positive, as ROS does, so a burst lasts one resampling.
    """
    if averages[0] <= 0.0:
        return 0.0
    chance = max(0.0, 1.0 - averages[1] / averages[0])
    if chance > 0.0:
        averages[0] = 0.0
        averages[1] = 0.0
    return chance


@kernel(_nrt=False, error_model="numpy")
def accumulate(weights, count, cumulative, guide):
    """Cumulative weights, and for each of ``count`` equal slices the first index reaching into it.

    Weights need no normalisation. Returns their sum.
    """
    total = 0.0
    for i in range(count):
        total += weights[i]
        cumulative[i] = total
    slice_width = total / count
    i = 0
    for part in range(count):
        start = part * slice_width
        while i < count - 1 and cumulative[i] <= start:
            i += 1
        guide[part] = i
    return total


@kernel(_nrt=False, error_model="numpy")
def locate(cumulative, guide, count, total, u):
    """First index whose cumulative weight exceeds ``u`` (in [0, 1)) of ``total``."""
    i = np.int64(guide[np.int64(u * count)])
    threshold = u * total
    # The first step is an addition, not a branch: half of the draws take it, unpredictably.
    # Only the last sum can fall short of the threshold by rounding, so it is bounded too.
    i = min(i + np.int64(cumulative[i] <= threshold), count - 1)
    while i < count - 1 and cumulative[i] <= threshold:
        i += 1
    return i


@kernel(_nrt=False, error_model="numpy")
def draw(cumulative, guide, count, total, state):
    """Index drawn with probability proportional to its weight; one uniform per draw."""
    return locate(cumulative, guide, count, total, uniform(state))


@kernel(_nrt=False, error_model="numpy")
def inject(target, n, field, state):
    """Particle ``n`` of ``target``: centre of a uniformly drawn free cell, uniform heading."""
    cell = field.free_cells[np.int64(uniform(state) * field.free_cells.size)]
    row = cell // field.width
    column = cell - row * field.width
    target[0, n] = field.origin_x + (column + 0.5) * field.resolution
    target[1, n] = field.origin_y + (row + 0.5) * field.resolution
    yaw = (2.0 * uniform(state) - 1.0) * math.pi
    set_heading(target, n, yaw)


@njit(inline="always")
def most_particles(target, scratch, limits):
    """The most particles that a new set may have: as ``limits`` say, where there is the room."""
    return min(limits.size - 1, target.shape[1], scratch.bin_of.size)


@kernel(_nrt=False, error_model="numpy")
def resample(source, weights, count, target, scratch, bins, limits, chance, field, state):
    """Draw a new set into ``target`` (rows x, y, yaw, cos, sin) until the KLD bound is passed.

    ``scratch`` offers ``cumulative``, ``guide``, ``keys`` (of the source's particles) and
    ``bin_of`` (out: bin of each new particle). Returns the new count (at most ``limits.size - 1``)
    and the number of occupied bins. ``bins`` must be empty.
    """
    total = accumulate(weights, count, scratch.cumulative, scratch.guide)
    if chance <= 0.0:
        return _draw_set(source, count, total, target, scratch, bins, limits, state)
    most = most_particles(target, scratch, limits)
    n = 0
    k = 0
    while n < most:
        if uniform(state) < chance:
            inject(target, n, field, state)
            key = bin_key(target[0, n], target[1, n], target[2, n], bins)
        else:
            i = draw(scratch.cumulative, scratch.guide, count, total, state)
            for row in range(5):
                target[row, n] = source[row, i]
            key = scratch.keys[i]
        scratch.bin_of[n], k = insert(key, bins, k)
        n += 1
        if n > limits[k]:
            break
    return n, k


@kernel(_nrt=False, error_model="numpy")
def _draw_set(source, count, total, target, scratch, bins, limits, state):
    """``resample`` without injection, in blocks: each pass over one does one simple thing."""
    most = most_particles(target, scratch, limits)
    chosen = scratch.indices[0]  # of the sensor model, which is done
    uniforms = scratch.noise[0]
    n = 0
    k = 0
    while n < most:
        size = min(_BLOCK, most - n)
        fill_uniforms(state, uniforms[:size])
        for j in range(size):
            chosen[j] = locate(scratch.cumulative, scratch.guide, count, total, uniforms[j])
        for j in range(size):
            scratch.bin_of[n + j], k = insert(scratch.keys[chosen[j]], bins, k)
            if n + j + 1 > limits[k]:
                size = j + 1
                most = n + size
                break
        for row in range(5):
            for j in range(size):
                target[row, n + j] = source[row, chosen[j]]
        n += size
    return n, k
