"""The social force model as libpedsim computes it (Moussaid & Helbing 2009).

``velocity' = decay * velocity + gain * force``, capped. libpedsim halves the velocity every step
of the group's 0.4 s; decay and gain are that rule for any tick, equal to it at 0.4 s.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from lndrl.maps.raycast import sample_field


@njit(cache=True, nogil=True)
def social_force(
    agent, position, velocity, agents, strength_lambda, gamma, n, n_prime, cutoff, silent
):
    """Sum of the repulsions (fx, fy) that ``agent`` feels from the other rows.

    Row ``silent`` (the robot; -1 for none) is felt by position only: its velocity counts as 0.
    """
    force_x = 0.0
    force_y = 0.0
    for other in range(agents):
        if other == agent:
            continue
        dx = position[other, 0] - position[agent, 0]
        dy = position[other, 1] - position[agent, 1]
        distance2 = dx * dx + dy * dy
        if distance2 > cutoff * cutoff or distance2 < 1e-12:
            continue
        distance = np.sqrt(distance2)
        dx /= distance
        dy /= distance
        other_vx = 0.0 if other == silent else velocity[other, 0]
        other_vy = 0.0 if other == silent else velocity[other, 1]
        ix = strength_lambda * (velocity[agent, 0] - other_vx) + dx
        iy = strength_lambda * (velocity[agent, 1] - other_vy) + dy
        length = np.sqrt(ix * ix + iy * iy)
        if length < 1e-9:
            continue
        ix /= length
        iy /= length
        scale = gamma * length
        fade = distance / scale
        if fade > 20.0:  # below 2e-9: not worth two exponentials
            continue
        theta = np.arctan2(ix * dy - iy * dx, ix * dx + iy * dy)
        slow_down = -np.exp(-fade - (n_prime * scale * theta) ** 2)
        turn = -np.sign(theta) * np.exp(-fade - (n * scale * theta) ** 2)
        force_x += slow_down * ix - turn * iy
        force_y += slow_down * iy + turn * ix
    return force_x, force_y


@njit(cache=True, nogil=True)
def obstacle_force(distance, inverse_resolution, x, y, radius, sigma):
    """Push (fx, fy) away from the nearest wall, ``exp(-(clearance - radius) / sigma)``.

    Along the field's slope and scaled by it, so between two equally near walls it vanishes
    instead of flipping from tick to tick.
    """
    reach = 1.0 / inverse_resolution
    slope_x = (
        sample_field(distance, inverse_resolution, x + reach, y)
        - sample_field(distance, inverse_resolution, x - reach, y)
    ) / (2.0 * reach)
    slope_y = (
        sample_field(distance, inverse_resolution, x, y + reach)
        - sample_field(distance, inverse_resolution, x, y - reach)
    ) / (2.0 * reach)
    room = sample_field(distance, inverse_resolution, x, y) - 0.5 * reach
    amount = np.exp(-(room - radius) / sigma)
    return amount * slope_x, amount * slope_y


@njit(cache=True, nogil=True)
def relaxation(tick, period):
    """Decay and gain of the velocity update over ``tick`` seconds (see the module's text)."""
    decay = 0.5 ** (tick / period)
    return decay, 2.0 * period * (1.0 - decay)
