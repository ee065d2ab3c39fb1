"""Observations made by hand, and small worlds to drive in."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from lndrl.navigation import Observation
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.planners import Planner

RANGE, BEAMS, PERIOD = 12.0, 720, 0.4
BEARINGS = -math.pi / 2 + np.arange(BEAMS) * math.pi / BEAMS

Person = tuple[float, float, float, float]
"""x, y (m), vx, vy (m/s)."""


def seen(
    goal: tuple[float, float],
    ranges: NDArray[np.float64] | None = None,
    people: Sequence[Person] = (),
    variances: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Observation:
    """One observation (1,): a goal and people in the robot frame, ``ranges`` (720,) in m."""
    observation = Observation.zeros(1)
    observation.goal[0] = (*goal, 0.0, *variances)
    free = np.full(BEAMS, RANGE) if ranges is None else np.minimum(ranges, RANGE)
    observation.scan[0] = np.rint(free / RANGE * SCAN_COUNTS)
    observation.pedestrian_count[0] = len(people)
    for row, person in enumerate(people):
        observation.pedestrians[0, row] = person
    return observation


def wall_ahead(distance: float, yaw: float = 0.0) -> NDArray[np.float64]:
    """Ranges (m) to an endless wall ``distance`` m in front of a robot that looks ``yaw`` off."""
    facing = np.cos(BEARINGS + yaw)
    return np.where(facing > 1e-3, max(distance, 0.0) / np.maximum(facing, 1e-3), RANGE)


def panel_ahead(
    pose: NDArray[np.float64], distance: float, right: float, left: float
) -> NDArray[np.float64]:
    """Ranges (m) to a panel at x = ``distance`` m from y = ``right`` to ``left``, from ``pose``."""
    ranges = wall_ahead(distance - pose[0], pose[2])
    y = pose[1] + ranges * np.sin(BEARINGS + pose[2])
    hit = (ranges < RANGE) & (y > right) & (y < left) & (pose[0] < distance)
    return np.where(hit, ranges, RANGE)


def drive(
    planner: Planner,
    steps: int,
    goal: tuple[float, float],
    wall: float | None = None,
    panel: tuple[float, float, float] | None = None,
    people: Callable[[float], Sequence[Person]] = lambda time: (),
    variances: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Drive without noise from the origin; a wall stands at x = ``wall`` m, or a panel.

    ``people(time)`` in the world's frame. Returns poses (10 * steps + 1, 3), ten per control step,
    and commands (steps, 2).
    """
    planner.reset(0, [0])
    pose, poses, commands = np.zeros(3), [np.zeros(3)], []
    for step in range(steps):
        cosine, sine = math.cos(pose[2]), math.sin(pose[2])
        turn = np.array([[cosine, sine], [-sine, cosine]])
        there = [
            (*(turn @ (np.array(p[:2]) - pose[:2])), *(turn @ np.array(p[2:])))
            for p in people(step * PERIOD)
        ]
        ranges = None if wall is None else wall_ahead(wall - pose[0], pose[2])
        if panel is not None:
            ranges = panel_ahead(pose, *panel)
        x, y = turn @ (np.array(goal) - pose[:2])
        observation = seen((x, y), ranges, there, variances)
        v, w = planner.act(observation, np.arange(1))[0]
        commands.append((v, w))
        for _ in range(10):
            middle = pose[2] + 0.05 * w * PERIOD
            pose = pose + 0.1 * PERIOD * np.array([v * math.cos(middle), v * math.sin(middle), w])
            poses.append(pose)
    return np.array(poses), np.array(commands)
