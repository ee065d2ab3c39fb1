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
from lndrl.randomness import next_uniform, uniform

_BLOCK = 512  # particles drawn at a time; the usual set in one
NAMELESS = 6  # bins that are told apart without a look into their table
_SURE = 1e-9  # slices: what rounding could move a border by is a thousandth of it


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

    Weights need no normalisation. Returns their sum. An index that ends within a billionth of a
    slice's border may be named for the next slice as well; ``locate`` looks further from there.
    """
    count = min(count, weights.size, cumulative.size, guide.size)
    if count < 1:
        return 0.0
    guide[:count] = 0
    total = 0.0
    for i in range(count):
        total += weights[i]
        cumulative[i] = total
    # No walk from slice to slice, whose length nobody can predict: every index marks the slice that
    # it ends in, and the last one marked before a slice is behind it. No number marks the last.
    per_weight = count / total
    last = count - 1.0
    for i in range(count):
        end = cumulative[i] * per_weight + _SURE
        end = end if end < last else last
        end = end if end > 0.0 else 0.0
        guide[np.uint64(np.int64(end))] = np.int32(i + 1)
    first = np.int32(0)
    for part in range(np.uint64(count)):
        marked = guide[part]
        guide[part] = first
        first = max(first, marked)
    return total


@njit(inline="always", error_model="numpy")
def locate(cumulative, guide, count, total, u):
    """First index whose cumulative weight exceeds ``u`` (in [0, 1)) of ``total``."""
    # Without a sign: an index that may be negative is looked at before every load.
    last = np.uint64(count - 1)
    i = np.uint64(guide[np.uint64(np.int64(u * count))])
    threshold = u * total
    # The first step is an addition, not a branch: half of the draws take it, unpredictably.
    # Only the last sum can fall short of the threshold by rounding, so it is bounded too.
    i = min(i + np.uint64(cumulative[i] <= threshold), last)
    while i < last and cumulative[i] <= threshold:
        i += np.uint64(1)
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
    # Rows of the sensor model, which is done.
    chosen, name_of, bin_of_name = scratch.indices[0], scratch.indices[1], scratch.indices[2]
    names = name_keys(scratch.keys, count, name_of)
    bin_of_name[: NAMELESS + 1] = -1
    n = 0
    k = 0
    while n < most:
        size = min(_BLOCK, most - n)
        _choose(scratch.cumulative, scratch.guide, count, total, state, chosen[:size])
        if names == 1:
            if k == 0:
                _, k = insert(scratch.keys[0], bins, k)
            sorted_in = min(size, limits[1] + 1 - n)
            scratch.bin_of[n : n + sorted_in] = 0
        else:
            sorted_in, k = _sort_in(
                chosen[:size], name_of, bin_of_name, n, k, scratch, bins, limits
            )
        if sorted_in < size or n + sorted_in > limits[k]:
            most = n + sorted_in
        _copy(source, chosen[:sorted_in], target, n)
        n += sorted_in
    return n, k


@kernel(_nrt=False, error_model="numpy")
def _sort_in(chosen, name_of, bin_of_name, n, k, scratch, bins, limits):
    """Bins of the ``chosen`` into ``scratch.bin_of`` from ``n`` on, until the KLD bound is passed.

    Returns how many were sorted in, and the number of bins. A named key's bin is looked up once.
    """
    enough = limits[k]
    for j in range(chosen.size):
        i = np.uint64(chosen[j])
        name = np.uint64(name_of[i])
        b = bin_of_name[name]
        if b < 0:
            b, k = insert(scratch.keys[i], bins, k)
            enough = limits[k]
            if name < NAMELESS:
                bin_of_name[name] = b
        scratch.bin_of[n + j] = b
        if n + j >= enough:
            return j + 1, k
    return chosen.size, k


@kernel(_nrt=False, error_model="numpy")
def _choose(cumulative, guide, count, total, state, chosen):
    """``draw`` for each of ``chosen`` (int32), one after the other.

    The generator's words stay in registers: its draws wait for each other, and the search for one
    goes on meanwhile.
    """
    s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    for j in range(np.uint64(chosen.size)):
        u, s0, s1, s2, s3 = next_uniform(s0, s1, s2, s3)
        chosen[j] = np.int32(locate(cumulative, guide, count, total, u))
    state[0], state[1], state[2], state[3] = s0, s1, s2, s3


@kernel(_nrt=False, error_model="numpy")
def name_keys(keys, count, name_of):
    """Number the different ones among ``count`` keys into ``name_of`` (int32), from 0 up.

    The first ``NAMELESS`` of them; what is left is called ``NAMELESS``. Returns how many there are,
    ``NAMELESS`` for that many or more. A pass over all keys for each costs less than looking up
    every particle's while the cloud is tight, as it mostly is.
    """
    for i in range(count):
        name_of[i] = np.int32(NAMELESS)
    first = 0
    for name in range(np.int32(NAMELESS)):
        key = keys[first]
        for i in range(count):
            name_of[i] = name if keys[i] == key else name_of[i]
        while name_of[first] < NAMELESS:
            first += 1
            if first >= count:
                return name + 1
    return NAMELESS


@kernel(_nrt=False, error_model="numpy")
def _copy(source, chosen, target, at):
    """Copy the ``chosen`` particles of ``source`` to ``target``, from ``at`` on."""
    start = np.uint64(at)
    for j in range(np.uint64(chosen.size)):
        i = np.uint64(chosen[j])
        o = start + j
        target[np.uint64(0), o] = source[np.uint64(0), i]
        target[np.uint64(1), o] = source[np.uint64(1), i]
        target[np.uint64(2), o] = source[np.uint64(2), i]
        target[np.uint64(3), o] = source[np.uint64(3), i]
        target[np.uint64(4), o] = source[np.uint64(4), i]
