"""Low-variance draws that KLD sampling can stop at any time.

The textbook's systematic sweep needs the number of draws beforehand and visits the set from one
end to the other, so a rule that counts bins on the way sees one corner first. Here the n-th draw
is at ``frac(u + n g)`` of the cumulative weights, with g the golden section and one random u: the
first n points are spread evenly over the whole set for EVERY n (three-distance theorem), and each
single point is uniform, so after n draws particle i has n w_i copies in expectation, as with
independent draws, but with far less scatter. O(N) through the guide table.
"""

from __future__ import annotations

import numpy as np

from lndrl.kernels import kernel
from lndrl.localization.bins import bin_key, insert
from lndrl.localization.resampling import accumulate, inject, locate, most_particles
from lndrl.randomness import uniform

GOLDEN = 0.6180339887498949


@kernel(_nrt=False, error_model="numpy")
def resample_systematic(
    source, weights, count, target, scratch, bins, limits, chance, field, state
):
    """As ``resampling.resample``, arguments and result, with evenly spread draws."""
    total = accumulate(weights, count, scratch.cumulative, scratch.guide)
    most = most_particles(target, scratch, limits)
    u = uniform(state)
    n = 0
    k = 0
    while n < most:
        if chance > 0.0 and uniform(state) < chance:
            inject(target, n, field, state)
            key = bin_key(target[0, n], target[1, n], target[2, n], bins)
        else:
            i = locate(scratch.cumulative, scratch.guide, count, total, u)
            u += GOLDEN
            u -= np.floor(u)
            for row in range(5):
                target[row, n] = source[row, i]
            key = scratch.keys[i]
        scratch.bin_of[n], k = insert(key, bins, k)
        n += 1
        if n > limits[k]:
            break
    return n, k
