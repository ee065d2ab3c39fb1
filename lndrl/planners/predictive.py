"""A planner that looks ahead: two actions in sequence among walls that stand and people who walk.

Sees what the policy sees: the laser, the people around and the goal at the estimated pose. Takes no
account of the variances. Everything but the method is ours (docs/planners.md).
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from lndrl.config import RunConfig
from lndrl.models import Model, NonNegative, Positive, Seconds
from lndrl.navigation import Observation, action_table
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.planners.rollouts import (
    Prices,
    Rollouts,
    decide,
    limited_rollouts,
    make_rollouts,
)
from lndrl.world.odometry import velocities

_FEATURES = 48  # echoes that stand for what is seen
_KEPT = 256
"""Starting velocities whose rollouts are kept, of some 230 kB each and 13 ms of work. A TurtleBot2
has 68 of them at the ends of control steps."""


class PredictiveConfig(Model):
    """Parameters of the planner (ours); clearances are from the robot's edge."""

    first_horizon: Seconds = Field(0.8, le=10.0, description="s that the first action is followed")
    second_horizon: Seconds = Field(2.4, le=10.0, description="s that the second is, from there")
    sample_period: Seconds = Field(
        0.2, ge=0.02, description="s between two looks at the clearance, at most"
    )
    goal_weight: NonNegative = Field(10.0, description="per metre from the end to the goal")
    heading_weight: NonNegative = Field(1.5, description="per rad that the end looks past the goal")
    turning_weight: NonNegative = Field(0.1, description="per rad turned on the way")
    wall_weight: NonNegative = Field(2.0, description="of a wall at the robot's edge")
    wall_reach: Positive = Field(0.2, description="m from a wall at which its price is 0")
    person_weight: NonNegative = Field(24.0, description="of a person at the robot's edge")
    person_reach: Positive = Field(0.4, description="m from a person at which the price is 0")
    person_radius: NonNegative = Field(0.2, description="m of a person; legs reach as far (GROUP)")
    wall_margin: NonNegative = Field(
        0.05, description="m of clearance below which a wall is touched"
    )
    person_margin: NonNegative = Field(0.25, description="m of clearance below which a person is")
    touch_weight: NonNegative = Field(1000.0, description="of what would be touched at once")
    touch_fade: Seconds = Field(0.5, description="s in which the price of touching falls by e")
    people_hide: NonNegative = Field(
        0.4, description="m around a person within which echoes are the person's"
    )
    detour_reach: NonNegative = Field(
        0.0,
        le=20.0,
        description="m around the robot in which ways around walls are sought; 0: none",
    )
    detour_cell: Positive = Field(0.2, ge=0.1, description="m of the grid in which they are sought")
    detour_blocked: NonNegative = Field(0.25, le=5.0, description="m from a wall that are no way")
    detour_close: NonNegative = Field(0.45, le=5.0, description="m from a wall that are avoided")
    view_weight: NonNegative = Field(
        0.0, description="of an end from which nothing is seen of the walls that are seen now"
    )
    spacing: NonNegative = Field(0.06, description="m between neighbouring echoes that count")

    @model_validator(mode="after")
    def _blocked_is_close(self) -> Self:
        if self.detour_blocked > self.detour_close:
            raise ValueError(
                f"detour_blocked {self.detour_blocked:g} must not exceed detour_close "
                f"({self.detour_close:g}): what is blocked is avoided, too"
            )
        return self


class PredictivePlanner:
    """Rolls out every pair of actions and takes the first of the cheapest pair.

    Cost of a pair: distance and bearing of the goal from its end, turning, and closeness to walls
    and to people, who are expected to walk on as they do. What would be touched later costs less
    than what would be touched at once. Nothing is remembered from step to step, unless the robot's
    acceleration is limited (``world.robot.acceleration``): then how fast it drives by now, which
    follows from what it was told.
    """

    name = "predictive"

    def __init__(self, config: RunConfig, parameters: PredictiveConfig | None = None) -> None:
        self.parameters = p = parameters or PredictiveConfig()
        laser = config.world.laser
        self._actions = action_table(config.task)
        self._first = _times(p.first_horizon, p.sample_period)
        self._second = _times(p.second_horizon, p.sample_period)
        self._rollouts = make_rollouts(
            self._actions, self._first, self._second, self._turning_price()
        )
        limits = config.world.robot.acceleration.limits
        self._limits = limits if np.isfinite(limits).any() else None
        self._tick, self._ticks = config.world.tick, config.world.ticks_per_step
        self._speeds = np.zeros((0, 2))
        self._limited: OrderedDict[tuple[float, float], Rollouts] = OrderedDict()
        fastest = np.abs(self._actions[:, 0]).max()
        self._prices = Prices(
            p.goal_weight, p.heading_weight, p.wall_weight, p.wall_reach, p.person_weight,
            p.person_reach, p.touch_weight, p.touch_fade, p.wall_margin, p.person_margin,
            config.world.robot_radius, p.person_radius, config.task.arrive_distance,
            p.goal_weight * fastest, p.detour_cell, p.detour_blocked, p.detour_close,
            p.view_weight, laser.range_max,
        )  # fmt: skip
        self._beams = laser.beams
        bearing = laser.field_of_view * (np.arange(laser.beams) / laser.beams - 0.5)
        self._directions = np.stack((np.cos(bearing), np.sin(bearing)), axis=1)
        self._scale = laser.range_max / SCAN_COUNTS
        self._reach = (
            fastest * (p.first_horizon + p.second_horizon)
            + config.world.robot_radius
            + max(p.wall_reach, p.wall_margin)
        )
        # All around where ways are sought or features kept in view; else what can be touched.
        self._sight = max(self._reach, 1.5 * p.detour_reach)
        if p.view_weight > 0.0:
            self._sight = laser.range_max
        self._points = np.empty((laser.beams, 2))
        self._base = np.empty(len(self._actions))
        self._ends = np.empty(len(self._actions), np.int64)
        cells = 2 * int(np.ceil(p.detour_reach / p.detour_cell)) + 1
        self._effort = np.empty((cells, cells))
        self._detours = np.zeros((cells, cells))
        self._features = np.empty((_FEATURES if p.view_weight > 0.0 else 0, 2))
        self._stand = int(np.argmin(np.abs(self._actions).sum(axis=1)))

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """See ``Planner.reset``: every robot stands. Nothing is random."""
        self._speeds = np.zeros((len(worlds), 2))

    def act(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """See ``Planner.act``; stands still where the goal is not a number."""
        costs = self._decide(observation, every=False, rows=rows)
        command = self._actions[self._cheapest(costs)]
        self.told(command, rows)
        return command

    def costs(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Costs (B, A) of beginning with each action of the table, the second the best after it.

        ``act`` takes the least. Infinite where the goal is not a number.
        """
        return self._decide(observation, every=True, rows=rows)

    def begin(self, rows: NDArray[np.int64]) -> None:
        """Episodes begin at ``rows``: what was remembered of them is over."""
        if self._limits is not None:
            self._speeds[rows] = 0.0

    def told(self, commands: NDArray[np.float64], rows: NDArray[np.int64]) -> None:
        """Hear what the robots at ``rows`` (B,) were told, (B, 2): m/s and rad/s.

        For whoever asks for ``costs`` and decides himself; ``act`` knows what it says.
        """
        if self._limits is not None:
            start = self._speeds[rows]
            driven = velocities(start, commands, self._limits, self._tick, self._ticks)
            self._speeds[rows] = driven[:, -1]

    def measured(self, speeds: NDArray[np.float64], rows: NDArray[np.int64]) -> None:
        """The robots at ``rows`` (B,) drive ``speeds`` (B, 2) now, whatever they were told."""
        if self._limits is not None:
            self._speeds[rows] = speeds

    def _turning_price(self) -> NDArray[np.float64]:
        """What the turning of every pair costs, (A, A)."""
        p, turned = self.parameters, np.abs(self._actions[:, 1])
        each = p.first_horizon * turned[:, None] + p.second_horizon * turned[None]
        return p.turning_weight * each

    def _cheapest(self, costs: NDArray[np.float64]) -> NDArray[np.int64]:
        """The cheapest of ``costs`` (B, A), (B,); standing still where none is a number."""
        chosen = costs.argmin(axis=1)
        chosen[np.isinf(costs).all(axis=1)] = self._stand
        return chosen

    def _decide(
        self,
        observation: Observation,
        every: bool,
        goals: NDArray[np.floating] | None = None,
        turning: NDArray[np.float64] | None = None,
        start: NDArray[np.float64] | None = None,
        rows: NDArray[np.int64] | None = None,
    ) -> NDArray[np.float64]:
        """Costs (B, A), of all or of those that may be the least; by default the observed goals,
        the plain price of turning, and nothing for how it starts. ``rows`` (B,): whose they are."""
        count = len(observation)
        goals = observation.goal if goals is None else goals
        turning = np.ones(count) if turning is None else turning
        start = np.zeros((count, len(self._actions))) if start is None else start
        if self._limits is None or rows is None:
            return self._measure(self._rollouts, observation, every, goals, turning, start)
        out = np.empty((count, len(self._actions)))
        for i, row in enumerate(rows):
            only = slice(i, i + 1)
            out[only] = self._measure(
                self._from(self._speeds[row]), observation.take(only), every,
                goals[only], turning[only], start[only],
            )  # fmt: skip
        return out

    def _from(self, speeds: NDArray[np.float64]) -> Rollouts:
        """Rollouts of a robot that drives ``speeds`` (2,) by now; the last few are kept."""
        assert self._limits is not None
        key = round(float(speeds[0]), 6), round(float(speeds[1]), 6)
        made = self._limited.pop(key, None)
        if made is None:
            made = limited_rollouts(
                self._actions, self._first, self._second, self._rollouts.price, speeds,
                self._limits, self._tick,
            )  # fmt: skip
        self._limited[key] = made
        if len(self._limited) > _KEPT:
            self._limited.popitem(last=False)
        # Whoever prices places of a map, too, changes the prices from step to step.
        return made._replace(price=self._rollouts.price)

    def _measure(
        self,
        rollouts: Rollouts,
        observation: Observation,
        every: bool,
        goals: NDArray[np.floating],
        turning: NDArray[np.float64],
        start: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Costs (B, A) of ``rollouts``, the same for all."""
        out = np.empty((len(observation), len(self._actions)))
        p = self.parameters
        decide(
            observation.scan[:, -self._beams :], self._directions, self._scale, self._sight,
            self._reach, p.spacing, observation.pedestrians, observation.pedestrian_count,
            p.people_hide, goals, rollouts, self._prices, turning, start, every, self._points,
            self._base, self._ends, self._effort, self._detours, self._features, out,
        )  # fmt: skip
        return out


def _times(horizon: float, period: float) -> NDArray[np.float64]:
    """Evenly up to ``horizon`` s, its end included, no further apart than ``period``."""
    count = max(1, int(np.ceil(horizon / period - 1e-9)))
    return horizon * np.arange(1, count + 1) / count
