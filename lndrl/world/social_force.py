"""The social force model as libpedsim computes it (Moussaid & Helbing 2009).

``velocity' = decay * velocity + gain * force``, capped. libpedsim halves the velocity every step
of the group's 0.4 s; decay and gain are that rule for any tick, equal to it at 0.4 s.
"""

from __future__ import annotations

import numpy as np

from lndrl.kernels import kernel
from lndrl.maps.raycast import sample_field
from lndrl.world.elementary import NOTHING, angle_of, exp_minus


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def pair_force(dx, dy, slip_x, slip_y, strength_lambda, gamma, n, n_prime, cutoff):
    """Repulsion (fx, fy) that an agent feels from another, who feels its negative.

    (dx, dy) is the other's position minus the agent's (m), ``slip_*`` the agent's velocity minus
    the other's (m/s). Exact to 1e-7; 0 beyond ``cutoff`` m. Of two at one point each has the
    other on another side: this one sees it along +x.
    """
    square = dx * dx + dy * dy
    if square > cutoff * cutoff:
        return 0.0, 0.0
    if square < 1e-12:
        distance = 0.0
        dx, dy = 1.0, 0.0
    else:
        distance = np.sqrt(square)
        inverse = 1.0 / distance
        dx *= inverse
        dy *= inverse
    ix = strength_lambda * slip_x + dx
    iy = strength_lambda * slip_y + dy
    length2 = ix * ix + iy * iy
    if length2 < 1e-18 or square > (NOTHING * gamma) ** 2 * length2:
        return 0.0, 0.0
    length = np.sqrt(length2)
    scale = gamma * length
    fade = distance / scale
    theta = angle_of(ix * dy - iy * dx, ix * dx + iy * dy)
    bend = (scale * theta) ** 2
    slow_down = -exp_minus(fade + n_prime * n_prime * bend) / length
    turn = exp_minus(fade + n * n * bend) / length
    if theta > 0.0:
        turn = -turn
    elif theta == 0.0:
        turn = 0.0
    return slow_down * ix - turn * iy, slow_down * iy + turn * ix


@kernel(error_model="numpy", _nrt=False)
def social_forces(
    position,
    velocity,
    feels,
    agents,
    strength_lambda,
    gamma,
    n,
    n_prime,
    cutoff,
    silent,
    force,
):
    """Sum of the repulsions on each of the first ``agents`` rows with ``feels``, into ``force``.

    ``feels`` int64 (A,), 0: exerts forces, feels none (its row of ``force`` means nothing). Row
    ``silent`` (the robot; -1 for none) is felt by position only: its velocity counts as 0.
    """
    agents = min(agents, len(force), len(position))
    for i in range(agents):
        force[i, 0] = 0.0
        force[i, 1] = 0.0
    for i in range(agents):
        x, y = position[i, 0], position[i, 1]
        still = 0.0 if i == silent else 1.0
        vx, vy = still * velocity[i, 0], still * velocity[i, 1]
        for j in range(i + 1, agents):
            if feels[i] == 0 and feels[j] == 0:
                continue
            moves = 0.0 if j == silent else 1.0
            fx, fy = pair_force(
                position[j, 0] - x,
                position[j, 1] - y,
                vx - moves * velocity[j, 0],
                vy - moves * velocity[j, 1],
                strength_lambda,
                gamma,
                n,
                n_prime,
                cutoff,
            )
            force[i, 0] += fx
            force[i, 1] += fy
            force[j, 0] -= fx
            force[j, 1] -= fy


@kernel(error_model="numpy", _nrt=False)
def obstacle_force(distance, inverse_resolution, x, y, radius, sigma):
    """Push (fx, fy) away from the nearest wall, ``exp(-(clearance - radius) / sigma)``.

    Along the field's slope and scaled by it, so between two equally near walls it vanishes
    instead of flipping from tick to tick.
    """
    cell = 1.0 / inverse_resolution
    room, slope_x, slope_y = _slope(distance, inverse_resolution, x, y)
    over = (room - 0.5 * cell - radius) / sigma
    if over > NOTHING:
        return 0.0, 0.0
    amount = exp_minus(over) if over >= 0.0 else 1.0 / exp_minus(-over)
    amount *= 0.5 * inverse_resolution
    return amount * slope_x, amount * slope_y


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _slope(distance, inverse_resolution, x, y):
    """Field at a point, and its differences over two cells in x and in y."""
    column = x * inverse_resolution - 0.5
    row = y * inverse_resolution - 0.5
    rows, columns = distance.shape
    if column >= 1.0 and row >= 1.0 and column < columns - 2.0 and row < rows - 2.0:
        # Samples a cell apart share their weights: twelve cells instead of twenty.
        c, r = int(column), int(row)
        a, b = column - c, row - r
        p, q = 1.0 - a, 1.0 - b
        d00, d01, d10, d11 = (
            distance[r, c],
            distance[r, c + 1],
            distance[r + 1, c],
            distance[r + 1, c + 1],
        )
        low, high = p * d00 + a * d01, p * d10 + a * d11
        right = q * (p * d01 + a * distance[r, c + 2]) + b * (p * d11 + a * distance[r + 1, c + 2])
        left = q * (p * distance[r, c - 1] + a * d00) + b * (p * distance[r + 1, c - 1] + a * d10)
        above = q * high + b * (p * distance[r + 2, c] + a * distance[r + 2, c + 1])
        below = q * (p * distance[r - 1, c] + a * distance[r - 1, c + 1]) + b * low
        return q * low + b * high, right - left, above - below
    cell = 1.0 / inverse_resolution
    return (
        sample_field(distance, inverse_resolution, x, y),
        sample_field(distance, inverse_resolution, x + cell, y)
        - sample_field(distance, inverse_resolution, x - cell, y),
        sample_field(distance, inverse_resolution, x, y + cell)
        - sample_field(distance, inverse_resolution, x, y - cell),
    )


@kernel()
def relaxation(tick, period):
    """Decay and gain of the velocity update over ``tick`` seconds (see the module's text)."""
    decay = 0.5 ** (tick / period)
    return decay, 2.0 * period * (1.0 - decay)
