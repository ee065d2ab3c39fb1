"""The planner that looks ahead, with the belief in mind: gentle turns, features in view, waiting.

What loses a robot like ours is slip while it turns: per control step an error in proportion to the
rate, so that the variance of a turn's error grows with its angle and its rate. It is therefore the
square of the rate over time that is dear here, not the angle. Sees what the policy sees. All of it
is ours (docs/planners.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lndrl.config import RunConfig
from lndrl.models import NonNegative, Positive, Seconds
from lndrl.navigation import Observation
from lndrl.planners.predictive import PredictiveConfig, PredictivePlanner


class CarefulConfig(PredictiveConfig):
    """Parameters of the planner (ours): those of ``predictive``, and what the belief asks for."""

    second_horizon: Seconds = Field(
        3.2, le=60.0, description="s that the second action is followed"
    )
    heading_weight: NonNegative = Field(4.0, description="per rad that the end looks past the way")
    wall_weight: NonNegative = Field(4.0, description="of a wall at the robot's edge")
    person_weight: NonNegative = Field(8.0, description="of a person at the robot's edge")
    person_reach: Positive = Field(0.9, description="m from a person at which the price is 0")
    touch_fade: Seconds = Field(1.0, description="s in which the price of touching falls by e")
    detour_reach: NonNegative = Field(
        8.0,
        le=50.0,
        description="m around the robot in which ways around walls are sought; 0: none",
    )
    rate_weight: NonNegative = Field(5.0, description="per rad²/s: the square of a turn's rate")
    gentle_rate: NonNegative = Field(0.3, description="rad/s, above which a turn is sharp")
    sharp_weight: NonNegative = Field(20.0, description="of a first action that turns sharply")
    sharp_later: NonNegative = Field(0.0, description="share of it for the second action")
    stand_weight: NonNegative = Field(6.0, description="of standing still first")
    slow_weight: NonNegative = Field(1.0, description="per m/s below the fastest, at first")
    spot_weight: NonNegative = Field(0.0, description="per rad turned at no speed")
    change_weight: NonNegative = Field(2.0, description="per rad/s that the rate changes")
    doubt_weight: NonNegative = Field(1.0, description="times turning is dearer per m² + rad²")
    crowd_weight: NonNegative = Field(0.0, description="per m/s, times the hidden share")
    speed_weight: NonNegative = Field(0.0, description="per m²/s: the square of the velocity")


class CarefulPlanner(PredictivePlanner):
    """Prices the rate of turns, their changes, and sharp ones."""

    name = "careful"

    def __init__(self, config: RunConfig, parameters: CarefulConfig | None = None) -> None:
        self._careful = parameters or CarefulConfig()
        super().__init__(config, self._careful)
        self._period = config.world.tick * config.world.ticks_per_step
        self._delay = config.localization.delay
        self._commands = np.zeros((0, self._delay + 1, 2))

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        self._commands = np.zeros((len(worlds), self._delay + 1, 2))

    def act(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        costs = self._costs(observation, rows, every=False)
        chosen = costs.argmin(axis=1)
        chosen[np.isinf(costs).all(axis=1)] = self._stand
        command = self._actions[chosen]
        self._commands[rows, :-1] = self._commands[rows, 1:]
        self._commands[rows, -1] = command
        return command

    def costs(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        return self._costs(observation, rows, every=True)

    def _turning_price(self) -> NDArray[np.float64]:
        p = self._careful
        v, w = self._actions.T
        each = p.first_horizon * (w * w)[:, None] + p.second_horizon * (w * w)[None]
        speed = p.first_horizon * (v * v)[:, None] + p.second_horizon * (v * v)[None]
        spot = np.abs(w) * (1.0 - v / v.max())
        each = each + p.spot_weight / max(p.rate_weight, 1e-9) * (
            p.first_horizon * spot[:, None] + p.second_horizon * spot[None]
        )
        change = np.abs(w[:, None] - w[None])
        sharp = np.abs(w) > p.gentle_rate + 1e-9
        return (
            super()._turning_price()
            + p.rate_weight * each
            + p.change_weight * change
            + p.speed_weight * speed
            + p.sharp_weight * (1.0 * sharp[:, None] + p.sharp_later * sharp[None])
        )

    def _costs(
        self, observation: Observation, rows: NDArray[np.int64], every: bool
    ) -> NDArray[np.float64]:
        p = self._careful
        last = self._commands[rows]
        start = p.change_weight * np.abs(self._actions[None, :, 1] - last[:, -1:, 1])
        v = self._actions[:, 0]
        start = start + p.slow_weight * (v.max() - v)
        start[:, self._stand] += p.stand_weight
        variance = observation.goal[:, 3:].astype(np.float64).sum(axis=1)
        turning = 1.0 + p.doubt_weight * np.minimum(np.nan_to_num(variance, nan=10.0), 10.0)
        if p.crowd_weight:
            count = observation.pedestrian_count
            people = observation.pedestrians
            x, y = people[..., 0], people[..., 1]
            there = np.arange(x.shape[1]) < count[:, None]
            ahead = there & (x > 0)
            d = np.hypot(x, y)
            hidden = (
                np.where(ahead, 2 * np.arctan2(0.25, np.maximum(d, 0.25)), 0.0).sum(axis=1)
                / math.pi
            )
            start = start + p.crowd_weight * np.minimum(hidden, 1.0)[:, None] * np.abs(
                self._actions[None, :, 0]
            )
        goals = observation.goal[:, :2].astype(np.float64)
        for k in range(self._delay):
            goals = self._moved(goals, last[:, k + 1])
        return self._decide(observation, every, goals, turning, start)

    def _moved(
        self, goals: NDArray[np.float64], command: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """``goals`` (B, 2) as they lie after a control step of ``command`` (B, 2)."""
        v, w = command.T
        turned = w * self._period
        chord = v * self._period * np.sinc(0.5 * turned / np.pi)
        x = goals[:, 0] - chord * np.cos(0.5 * turned)
        y = goals[:, 1] - chord * np.sin(0.5 * turned)
        c, s = np.cos(turned), np.sin(turned)
        return np.stack((c * x + s * y, c * y - s * x), axis=1)
