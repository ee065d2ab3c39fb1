"""The true state of one robot, its clock and its sensors' draws, as arrays for kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lndrl.kernels import kernel
from lndrl.randomness import State
from lndrl.world.odometry import draw_slip

Floats = NDArray[np.float64]


class Robot(NamedTuple):
    """One robot; with a leading world dimension on every array, many. Map frame, m, rad, s."""

    pose: Floats  # (3,) x, y, yaw
    odometry: Floats  # (3,) what the slipping wheels report, (0, 0, 0) at the start
    start: Floats  # (3,)
    goal: Floats  # (2,)
    command: Floats  # (2,) v, w
    slip: Floats  # (2,) factors of v and w in this control step
    clock: Floats  # (1,) since the start
    contact: NDArray[np.int64]  # (1,) see ``contacts.HITS``
    laser_random: State  # (4,)
    odometry_random: State  # (4,)
    deviation: Floats  # (1,) of the slip in this episode
    velocity: Floats  # (2,) v, w as they are; with limits on acceleration, behind the command


def make_robots(worlds: int, deviation: float = 0.0) -> Robot:
    """Robots of ``worlds`` worlds: every array has a leading world dimension.

    All zero, but for factors of slip, 1, and its ``deviation``.
    """
    return Robot(
        pose=np.zeros((worlds, 3)),
        odometry=np.zeros((worlds, 3)),
        start=np.zeros((worlds, 3)),
        goal=np.zeros((worlds, 2)),
        command=np.zeros((worlds, 2)),
        slip=np.ones((worlds, 2)),
        clock=np.zeros((worlds, 1)),
        contact=np.zeros((worlds, 1), np.int64),
        laser_random=np.zeros((worlds, 4), np.uint64),
        odometry_random=np.zeros((worlds, 4), np.uint64),
        deviation=np.full((worlds, 1), deviation),
        velocity=np.zeros((worlds, 2)),
    )


def robot_of(robots: Robot, world: int) -> Robot:
    """Views of one world's arrays in ``make_robots``."""
    return Robot(*(array[world] for array in robots))


@kernel(_nrt=False)
def take_command(robot, v, w):
    """Set the velocities of the coming ticks and draw how much the wheels slip in them."""
    robot.command[0] = v
    robot.command[1] = w
    draw_slip(robot.slip, robot.deviation[0], robot.odometry_random)
