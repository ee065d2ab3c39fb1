"""Motion of the differential drive and its odometer.

The robot follows the exact unicycle arc of its command; the odometer integrates the same arc with
v and w each multiplied by a slip factor from N(1, deviation^2), drawn once per control step
(parameters §4.1).
"""

from __future__ import annotations

import numpy as np

from lndrl.kernels import kernel
from lndrl.randomness import normal


@kernel(_nrt=False)
def wrap(angle):
    """Angle (rad) in [-pi, pi)."""
    wrapped = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped if wrapped < np.pi else -np.pi  # rounding may return the open end


@kernel(_nrt=False)
def drive(pose, v, w, time):
    """Move ``pose`` [x, y, yaw] (m, rad) in place along the arc of v (m/s), w (rad/s)."""
    yaw = pose[2]
    half = 0.5 * w * time
    # Chord of the arc: v t sinc(w t / 2) in the middle direction; also exact for w = 0.
    chord = v * time
    if abs(half) > 1e-9:
        chord *= np.sin(half) / half
    pose[0] += chord * np.cos(yaw + half)
    pose[1] += chord * np.sin(yaw + half)
    pose[2] = wrap(yaw + w * time)


@kernel(_nrt=False)
def draw_slip(slip, deviation, state):
    """Fill ``slip`` [factor of v, factor of w] from N(1, deviation^2), independent."""
    slip[0] = 1.0 + deviation * normal(state)
    slip[1] = 1.0 + deviation * normal(state)


@kernel(_nrt=False)
def move_robot(pose, odometry, command, slip, time):
    """One tick of the robot and its odometer, both in place; ``command`` [v, w]."""
    drive(pose, command[0], command[1], time)
    drive(odometry, command[0] * slip[0], command[1] * slip[1], time)
