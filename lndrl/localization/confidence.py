"""How sure the filter may be: beam agreement with every update, the cluster's spread on demand."""

from __future__ import annotations

import math

import numpy as np

from lndrl.kernels import kernel
from lndrl.localization.clusters import estimate


@kernel(_nrt=False, error_model="numpy")
def beam_agreement(beams, kept, pose, field):
    """Share of the ``kept`` beams that end near an obstacle when cast from ``pose`` [x, y, yaw].

    ``beams`` are the end points of ``beam_ends``; near is where the table exceeds
    ``field.agreement_level``. 0 when no beam is usable, or the pose is not finite.
    """
    if not (np.isfinite(pose[0]) and np.isfinite(pose[1]) and np.isfinite(pose[2])):
        return 0.0
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    x0 = (pose[0] - field.origin_x) / field.resolution + 1.0
    y0 = (pose[1] - field.origin_y) / field.resolution + 1.0
    last_x, last_y = field.columns - 0.5, field.rows - 0.5
    near = 0
    for b in range(kept):
        x = min(max(x0 + cosine * beams[0, b] - sine * beams[1, b], 0.5), last_x)
        y = min(max(y0 + sine * beams[0, b] + cosine * beams[1, b], 0.5), last_y)
        near += field.table[np.int64(y) * field.columns + np.int64(x)] > field.agreement_level
    return near / max(kept, 1)


@kernel(_nrt=False, error_model="numpy")
def effective_count(weights, count):
    """``1 / sum w^2`` of ``count`` normalised weights: how many particles still matter."""
    # Four sums that do not wait for each other, in an order that no processor changes.
    a = b = c = d = 0.0
    whole = count - count % 4
    for i in range(0, whole, 4):
        a += weights[i] * weights[i]
        b += weights[i + 1] * weights[i + 1]
        c += weights[i + 2] * weights[i + 2]
        d += weights[i + 3] * weights[i + 3]
    for i in range(whole, count):
        a += weights[i] * weights[i]
    return 1.0 / ((a + b) + (c + d))


@kernel(error_model="numpy")
def cluster_spread(particles, weights, count, bin_of, bins, k, covariance):
    """Write the (3, 3) covariance of the heaviest cluster; returns its share of the weight.

    Arguments as for ``clusters.estimate``, which see for the meaning of the yaw's variance.
    """
    pose = np.empty(3)
    estimate(particles, weights, count, bin_of, bins, k, pose, covariance)
    best = 0
    for b in range(k):
        if bins.parent[b] == b and bins.sums[0, b] > bins.sums[0, best]:
            best = b
    mass = xx = xy = yy = everything = 0.0
    for i in range(count):
        everything += weights[i]
        b = bin_of[i]
        while bins.parent[b] != b:
            b = bins.parent[b]
        if b == best:
            x = particles[0, i] - pose[0]
            y = particles[1, i] - pose[1]
            mass += weights[i]
            xx += weights[i] * x * x
            xy += weights[i] * x * y
            yy += weights[i] * y * y
    covariance[:] = 0.0
    covariance[0, 0] = xx / mass
    covariance[1, 1] = yy / mass
    covariance[0, 1] = covariance[1, 0] = xy / mass
    resultant = math.hypot(bins.sums[3, best], bins.sums[4, best]) / mass
    covariance[2, 2] = -2.0 * math.log(min(1.0, max(resultant, 1e-12)))
    return mass / everything
