"""Odometry motion model ``diff`` of ROS AMCL (Thrun et al. §5.4, table 5.6).

ROS hands the model's *variances* to a routine that expects standard deviations. The paper's
filter runs that way, which makes it over-confident in fast motion and is what lets it lose track;
so do we. Only ``deviations`` would change for a corrected model.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from lndrl.kernels import kernel
from lndrl.localization.angles import difference, sincos
from lndrl.randomness import fill_normals, fill_normals32, normal

LEAST_TRANSLATION = 0.01  # m; below it the direction of motion is only noise (ROS)


@kernel(_nrt=False, error_model="numpy")
def decompose(old, new):
    """Odometry poses (x, y, yaw) to ``(rotation1, translation, rotation2)`` in rad, m, rad."""
    dx = new[0] - old[0]
    dy = new[1] - old[1]
    translation = math.hypot(dx, dy)
    rotation1 = 0.0
    if translation >= LEAST_TRANSLATION:
        rotation1 = difference(math.atan2(dy, dx), old[2])
    rotation2 = difference(difference(new[2], old[2]), rotation1)
    return rotation1, translation, rotation2


@kernel(_nrt=False, error_model="numpy")
def deviations(rotation1, translation, rotation2, alpha):
    """Deviations of the three parts; ``alpha`` (4,) are odom_alpha1 to 4.

    Driving backward is folded onto driving forward: a half turn counts as no turn.
    """
    turn1 = min(abs(rotation1), abs(difference(rotation1, math.pi)))
    turn2 = min(abs(rotation2), abs(difference(rotation2, math.pi)))
    from_translation = alpha[1] * translation * translation
    return (
        alpha[0] * turn1 * turn1 + from_translation,
        alpha[2] * translation * translation + alpha[3] * (turn1 * turn1 + turn2 * turn2),
        alpha[0] * turn2 * turn2 + from_translation,
    )


@kernel(_nrt=False, error_model="numpy")
def draw_noise(noise, count, spread, state, normals):
    """Three normals per particle, scaled by ``spread``, into ``noise[0..2]``.

    They are drawn into ``normals`` (float32), what they are made in: twice as many at a time.
    """
    for part in range(3):
        fill_normals32(state, normals[:count])
        for i in range(count):
            noise[part, i] = np.float64(normals[i]) * spread[part]


@njit(inline="always")
def set_heading(particles, i, yaw):
    """Turn particle ``i`` (rows x, y, yaw, cos, sin) to ``yaw`` (rad), wrapped into [-pi, pi)."""
    yaw -= 2.0 * math.pi * np.floor((yaw + math.pi) * (0.5 / math.pi))
    yaw = yaw if yaw < math.pi else -math.pi
    sine, cosine = sincos(yaw)
    particles[2, i] = yaw
    particles[3, i] = cosine
    particles[4, i] = sine


@kernel(_nrt=False, error_model="numpy", fastmath=True)
def move(particles, count, motion, noise):
    """Move ``count`` particles (rows x, y, yaw, cos, sin) by ``motion`` less their noise."""
    rotation1, translation, rotation2 = motion
    for i in range(count):
        turn1 = rotation1 - noise[0, i]
        sine, cosine = sincos(turn1)
        distance = translation - noise[1, i]
        # The particle's heading is already known as cosine and sine: rotate it, not the angle.
        particles[0, i] += distance * (particles[3, i] * cosine - particles[4, i] * sine)
        particles[1, i] += distance * (particles[4, i] * cosine + particles[3, i] * sine)
        yaw = particles[2, i] + (turn1 + (rotation2 - noise[2, i]))
        set_heading(particles, i, yaw)


@kernel(_nrt=False, error_model="numpy")
def scatter(particles, count, pose, spread, state):
    """Gaussian cloud around ``pose``; ``spread`` holds the deviations of x, y (m) and yaw (rad)."""
    for row in range(3):
        fill_normals(state, particles[row, :count])
    _place_around(particles, count, pose, spread)


@kernel(_nrt=False, error_model="numpy", fastmath=True)
def _place_around(particles, count, pose, spread):
    for i in range(count):
        particles[0, i] = pose[0] + spread[0] * particles[0, i]
        particles[1, i] = pose[1] + spread[1] * particles[1, i]
        yaw = pose[2] + spread[2] * particles[2, i]
        set_heading(particles, i, yaw)


@kernel(_nrt=False, error_model="numpy")
def scatter_correlated(particles, count, pose, root, state):
    """As ``scatter``, with ``root`` (3, 3) a square root of the covariance of x, y, yaw."""
    for i in range(count):
        a, b, c = normal(state), normal(state), normal(state)
        particles[0, i] = pose[0] + root[0, 0] * a + root[0, 1] * b + root[0, 2] * c
        particles[1, i] = pose[1] + root[1, 0] * a + root[1, 1] * b + root[1, 2] * c
        yaw = pose[2] + root[2, 0] * a + root[2, 1] * b + root[2, 2] * c
        set_heading(particles, i, yaw)
