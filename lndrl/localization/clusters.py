"""Pose estimate: mean of the heaviest cluster, covariance of the whole set (as ROS publishes)."""

from __future__ import annotations

import math

import numpy as np

from lndrl.kernels import kernel
from lndrl.localization.bins import X_SHIFT, Y_SHIFT, find

# Half of the 26 neighbours; the other half are reached from the other side.
_NEIGHBOURS = np.array(
    [(1, row, turn) for row in (-1, 0, 1) for turn in (-1, 0, 1)]
    + [(0, 1, turn) for turn in (-1, 0, 1)]
    + [(0, 0, 1)],
    dtype=np.int64,
)


@kernel(_nrt=False, error_model="numpy")
def _root(parent, b):
    while parent[b] != b:
        parent[b] = parent[parent[b]]
        b = parent[b]
    return b


@kernel(_nrt=False, error_model="numpy")
def connect(bins, k):
    """Join the ``k`` bins that touch (3 x 3 x 3 neighbours, headings wrapped) in ``parent``."""
    for b in range(k):
        key = bins.key[b]
        heading = key & ((1 << Y_SHIFT) - 1)
        for i in range(_NEIGHBOURS.shape[0]):
            turned = heading + _NEIGHBOURS[i, 2]
            if turned < 0:
                turned += bins.headings
            elif turned >= bins.headings:
                turned -= bins.headings
            step = (_NEIGHBOURS[i, 0] << X_SHIFT) + (_NEIGHBOURS[i, 1] << Y_SHIFT)
            other = find(key + step + (turned - heading), bins)
            if other >= 0:
                mine = _root(bins.parent, b)
                theirs = _root(bins.parent, other)
                # The older root wins, so a cluster's name does not depend on the search order.
                bins.parent[max(mine, theirs)] = min(mine, theirs)


@kernel(_nrt=False, error_model="numpy")
def heaviest(bins, k):
    """Sum the bins' ``sums`` into their roots and return the root with the greatest mass."""
    for b in range(k):
        root = _root(bins.parent, b)
        if root != b:
            for row in range(5):
                bins.sums[row, root] += bins.sums[row, b]
    best = 0
    for b in range(k):
        if bins.parent[b] == b and bins.sums[0, b] > bins.sums[0, best]:
            best = b
    return best


@kernel(_nrt=False, error_model="numpy")
def _second(bins, k, best):
    """The root with the greatest mass but for ``best``, after ``heaviest``; -1 without one."""
    second = -1
    for b in range(k):
        root = bins.parent[b] == b and b != best
        if root and (second < 0 or bins.sums[0, b] > bins.sums[0, second]):
            second = b
    return second


@kernel(_nrt=False, error_model="numpy")
def two_heaviest(weights, count, bin_of, bins, k, masses):
    """Write the shares of the weight in the heaviest and the second heaviest cluster to ``masses``.

    ``masses`` is (2,). ``bin_of`` names the bin of each of ``count`` particles among the ``k`` of
    ``bins``, whose sums are empty, as ``fill_bins`` leaves them. 0 where there is no such cluster.
    """
    masses[:] = 0.0
    k = min(k, bins.key.size)
    everything = 0.0
    for i in range(min(count, weights.size, bin_of.size)):
        if 0 <= bin_of[i] < k:
            bins.sums[0, bin_of[i]] += weights[i]
            everything += weights[i]
    if not everything > 0.0:
        return
    connect(bins, k)
    best = heaviest(bins, k)
    second = _second(bins, k, best)
    masses[0] = bins.sums[0, best] / everything
    masses[1] = bins.sums[0, second] / everything if second >= 0 else 0.0


@kernel(_nrt=False, error_model="numpy")
def two_places(particles, weights, count, bin_of, bins, k, places):
    """Write share of the weight and mean x, y (m) of the two heaviest clusters to ``places``.

    ``places`` is (2, 3), the heaviest first; zeros where there is no such cluster. ``particles``
    has rows x, y, ...; all else as in ``two_heaviest``.
    """
    places[:] = 0.0
    k = min(k, bins.key.size)
    count = min(count, weights.size, bin_of.size, particles.shape[1])
    everything = 0.0
    for i in range(count):
        b = bin_of[i]
        if 0 <= b < k:
            w = weights[i]
            bins.sums[0, b] += w
            # Relative to one particle, as in ``estimate``.
            bins.sums[1, b] += w * (particles[0, i] - particles[0, 0])
            bins.sums[2, b] += w * (particles[1, i] - particles[1, 0])
            everything += w
    if not everything > 0.0:
        return
    connect(bins, k)
    best = heaviest(bins, k)
    for row, root in ((0, best), (1, _second(bins, k, best))):
        if root >= 0 and bins.sums[0, root] > 0.0:
            mass = bins.sums[0, root]
            places[row, 0] = mass / everything
            places[row, 1] = particles[0, 0] + bins.sums[1, root] / mass
            places[row, 2] = particles[1, 0] + bins.sums[2, root] / mass


@kernel(_nrt=False, error_model="numpy")
def estimate(particles, weights, count, bin_of, bins, k, pose, covariance):
    """Write ``pose`` (3,) and ``covariance`` (3, 3) of ``count`` weighted particles.

    ``particles`` has rows x, y, yaw, cos, sin; ``bin_of`` names each one's bin among ``k``. The
    variance of yaw is ``-2 ln R`` with R the mean resultant length; yaw has no covariances.
    """
    x0 = particles[0, 0]
    y0 = particles[1, 0]
    mass = sum_x = sum_y = sum_cos = sum_sin = xx = xy = yy = 0.0
    for i in range(count):
        w = weights[i]
        # Relative to one particle: a tight cloud far from the origin keeps its digits.
        x = particles[0, i] - x0
        y = particles[1, i] - y0
        wx = w * x
        wy = w * y
        cosine = w * particles[3, i]
        sine = w * particles[4, i]
        b = bin_of[i]
        bins.sums[0, b] += w
        bins.sums[1, b] += wx
        bins.sums[2, b] += wy
        bins.sums[3, b] += cosine
        bins.sums[4, b] += sine
        mass += w
        sum_x += wx
        sum_y += wy
        sum_cos += cosine
        sum_sin += sine
        xx += wx * x
        xy += wx * y
        yy += wy * y
    mean_x = sum_x / mass
    mean_y = sum_y / mass
    covariance[:] = 0.0
    covariance[0, 0] = max(0.0, xx / mass - mean_x * mean_x)
    covariance[1, 1] = max(0.0, yy / mass - mean_y * mean_y)
    covariance[0, 1] = covariance[1, 0] = xy / mass - mean_x * mean_y
    resultant = math.hypot(sum_cos, sum_sin) / mass
    covariance[2, 2] = -2.0 * math.log(min(1.0, max(resultant, 1e-12)))
    connect(bins, k)
    best = heaviest(bins, k)
    pose[0] = x0 + bins.sums[1, best] / bins.sums[0, best]
    pose[1] = y0 + bins.sums[2, best] / bins.sums[0, best]
    yaw = math.atan2(bins.sums[4, best], bins.sums[3, best])
    pose[2] = yaw if yaw < math.pi else -math.pi
