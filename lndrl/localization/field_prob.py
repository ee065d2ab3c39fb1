"""What ROS ``likelihood_field_prob`` adds to the likelihood field: products, and beam skipping.

The weight is the product of the beams' ``pz``. With ``log pz`` in the table the product is the
same sum of lookups as the plain field's, and the kernel is the same. Products span hundreds of
orders of magnitude, so nothing is exponentiated before the best particle's logarithm is taken off.
"""

from __future__ import annotations

import math

import numpy as np

from lndrl.kernels import kernel

CONVERGED = 0.5  # m; all particles this near to the mean on both axes (ROS)


@kernel(_nrt=False, error_model="numpy")
def weigh_logarithms(weights, likelihood, count, beams):
    """Multiply ``weights`` by ``exp(likelihood)`` and normalise them; float64 and float32 (count,).

    Returns the mean likelihood as the geometric mean over ``beams``, at most about 1, which is
    what recovery compares over time: the product itself would swing by many orders of magnitude
    with every beam. Weights that cannot be normalised become equal.
    """
    best = -np.inf
    for i in range(count):
        if weights[i] > 0.0:
            best = max(best, np.float64(likelihood[i]))
    total = 0.0
    if best > -np.inf:
        for i in range(count):
            weights[i] *= math.exp(min(0.0, np.float64(likelihood[i]) - best))
            total += weights[i]
    if not (0.0 < total < np.inf):
        for i in range(count):
            weights[i] = 1.0 / count
        return 0.0
    for i in range(count):
        weights[i] /= total
    # The sum starts at 1, as the plain field's does.
    return math.exp((best - 1.0 + math.log(total)) / max(beams, 1))


@kernel(_nrt=False, error_model="numpy")
def converged(particles, count):
    """Whether every particle lies within ``CONVERGED`` m of the mean on x and on y."""
    for row in range(2):
        mean = 0.0
        for i in range(count):
            mean += particles[row, i]
        mean /= count
        for i in range(count):
            if abs(particles[row, i] - mean) > CONVERGED:
                return False
    return True


@kernel(_nrt=False, error_model="numpy", fastmath=True)
def _near(table, columns, last_x, last_y, cells, count, beam_x, beam_y, level):
    """Number of particles for which this beam ends where the table exceeds ``level``."""
    first = np.float32(0.5)
    found = 0
    for i in range(count):
        x = cells[0, i] + cells[2, i] * beam_x - cells[3, i] * beam_y
        y = cells[1, i] + cells[3, i] * beam_x + cells[2, i] * beam_y
        x = min(max(x, first), last_x)
        y = min(max(y, first), last_y)
        found += table[np.int64(y) * columns + np.int64(x)] > level
    return found


@kernel(_nrt=False, error_model="numpy")
def skip_beams(field, cells, count, beams, kept, threshold, error_threshold):
    """Put the beams first that a share above ``threshold`` of the particles explains.

    A beam is explained where it ends nearer than ``beam_skip_distance`` to an obstacle. When
    ``error_threshold`` of the ``kept`` beams or more would go, the filter is probably wrong and
    all stay (ROS; it also counts readings at the maximum as skipped, we leave those out). Reorders
    ``beams`` in place and returns how many to use.
    """
    last_x = np.float32(field.columns - 0.5)
    last_y = np.float32(field.rows - 0.5)
    level = np.float32(field.skip_level)
    used = 0
    for b in range(kept):
        x, y = beams[0, b], beams[1, b]
        near = _near(field.table, field.columns, last_x, last_y, cells, count, x, y, level)
        if near > threshold * count:
            beams[0, b], beams[1, b] = beams[0, used], beams[1, used]
            beams[0, used], beams[1, used] = x, y
            used += 1
    return kept if kept - used >= error_threshold * kept else used
