"""Floors that a learned policy must beat: uniformly random, and straight to the goal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.navigation import Observation, action_table
from lndrl.planners.interface import episode_generator

TURN_FIRST = 0.7853981633974483
"""rad; a goal farther off the robot's heading is turned to on the spot (a quarter of a half
turn): driving there would only lead away from it."""


class RandomPlanner:
    """Draws uniformly from the action table."""

    name = "random"

    def __init__(self, config: RunConfig) -> None:
        self._actions = action_table(config.task)
        self._generators: list[np.random.Generator] = []

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """See ``Planner.reset``."""
        self._generators = [episode_generator(seed, world) for world in worlds]

    def act(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """See ``Planner.act``."""
        indices = [self._generators[row].integers(len(self._actions)) for row in rows]
        return self._actions[indices]


class StraightPlanner:
    """Turns to the goal estimate and drives; blind to walls and people.

    Uses the goal's x and y alone. Velocities lie within those of the action table but between
    its steps, so that the robot aims exactly.
    """

    name = "straight"

    def __init__(self, config: RunConfig) -> None:
        self._speed = max(config.task.linear_velocities)
        self._turn_left = max(config.task.angular_velocities)
        self._turn_right = min(config.task.angular_velocities)
        self._period = config.world.tick * config.world.ticks_per_step

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """See ``Planner.reset``; this planner remembers nothing."""

    def act(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """See ``Planner.act``."""
        goal = observation.goal[:, :2].astype(np.float64)
        bearing = np.arctan2(goal[:, 1], goal[:, 0])
        velocities = np.empty((len(rows), 2))
        velocities[:, 0] = np.where(np.abs(bearing) <= TURN_FIRST, self._speed, 0.0)
        # The turn that ends on the goal's bearing with the step, as far as the robot can.
        velocities[:, 1] = np.clip(bearing / self._period, self._turn_right, self._turn_left)
        return velocities
