"""The planner that looks ahead, with the belief in mind: gentle turns, features in view, waiting.

What loses a robot like ours is slip while it turns: per control step an error in proportion to the
rate, so that the variance of a turn's error grows with its angle and its rate. It is therefore the
square of the rate over time that is dear here, not the angle, and a turn that can be seen coming
begins early. Sees what the policy sees, and knows what it told the robot to do. All of it is ours
(docs/planners.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.models import NonNegative, Positive, Seconds
from lndrl.navigation import Observation
from lndrl.planners.predictive import PredictiveConfig, PredictivePlanner

_ROUNDING = 1e-9
_PERSON = 0.25  # m, half of what a person hides


class CarefulConfig(PredictiveConfig):
    """Parameters of the planner (ours): those of ``predictive``, and what the belief asks for."""

    second_horizon: Seconds = Field(3.2, le=10.0, description="s that the second is, from there")
    heading_weight: NonNegative = Field(4.0, description="per rad that the end looks past the way")
    wall_weight: NonNegative = Field(4.0, description="of a wall at the robot's edge")
    person_weight: NonNegative = Field(8.0, description="of a person at the robot's edge")
    person_reach: Positive = Field(0.9, description="m from a person at which the price is 0")
    touch_fade: Seconds = Field(1.0, description="s in which the price of touching falls by e")
    detour_reach: NonNegative = Field(
        8.0,
        le=20.0,
        description="m around the robot in which ways around walls are sought; 0: none",
    )
    rate_weight: NonNegative = Field(10.0, description="per rad²/s: the square of a turn's rate")
    change_weight: NonNegative = Field(4.0, description="per rad/s that the rate changes")
    gentle_rate: NonNegative = Field(0.3, description="rad/s, above which a turn is sharp")
    sharp_weight: NonNegative = Field(40.0, description="of a first action that turns sharply")
    settled_variance: Positive = Field(
        0.01, description="m² + rad² of the belief's variances, above which turning is cheaper"
    )
    doubt_weight: NonNegative = Field(
        1.0, description="how much dearer turning is per m² and rad² of the belief's variances"
    )
    slow_weight: NonNegative = Field(1.0, description="per m/s below the fastest, at first")
    stand_weight: NonNegative = Field(6.0, description="of standing still first")
    wait_weight: NonNegative = Field(
        0.0, description="per m/s, times the share of the view that people hide"
    )
    hears_commands: bool = Field(
        True,
        description="false: forgets what it told the robot, so that all it does follows from what "
        "is seen, as a policy's must",
    )


class CarefulPlanner(PredictivePlanner):
    """Rolls out what ``predictive`` does, and turns sharply only where all else would touch.

    Added to the cost of a pair: the square of the rate of turning over time, changes of the rate
    (from the last command, too), a sharp turn at first, all dearer while the variances are large;
    standing and slowness, or else it would rather stand than turn. The distance to the goal is that
    of a way around the walls in sight, so that it turns early. Where the pose is heard late, the
    goal is moved on by what it told the robot since. Raises UserError where nobody has variances
    (``localization.kind`` perfect).
    """

    name = "careful"

    def __init__(self, config: RunConfig, parameters: CarefulConfig | None = None) -> None:
        if config.localization.kind == "perfect":
            raise UserError(
                f"{self.name}: localization perfect has no variances and never gets lost; take "
                "predictive, or a filter (localization.kind: amcl)"
            )
        self._careful = parameters or CarefulConfig()
        super().__init__(config, self._careful)
        self._period = config.world.tick * config.world.ticks_per_step
        self._delay = config.localization.delay
        self._commands = np.zeros((0, self._delay + 1, 2))  # the newest last

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """See ``Planner.reset``: every robot stands. Nothing here is random."""
        super().reset(seed, worlds)
        self._commands = np.zeros((len(worlds), self._delay + 1, 2))

    def act(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """See ``Planner.act``; stands still where the goal is not a number."""
        command = self._actions[self._cheapest(self._costs(observation, rows, every=False))]
        self.told(command, rows)
        return command

    def costs(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """See ``PredictivePlanner.costs``; after what the robots at ``rows`` were told so far."""
        return self._costs(observation, rows, every=True)

    def begin(self, rows: NDArray[np.int64]) -> None:
        """See ``PredictivePlanner.begin``: these robots stand."""
        super().begin(rows)
        self._commands[rows] = 0.0

    def told(self, commands: NDArray[np.float64], rows: NDArray[np.int64]) -> None:
        """See ``PredictivePlanner.told``."""
        super().told(commands, rows)
        self._commands[rows, :-1] = self._commands[rows, 1:]
        self._commands[rows, -1] = commands

    def _turning_price(self) -> NDArray[np.float64]:
        p, w = self._careful, self._actions[:, 1]
        squares = p.first_horizon * (w * w)[:, None] + p.second_horizon * (w * w)
        change = np.abs(w[:, None] - w)
        sharp = np.abs(w) > p.gentle_rate + _ROUNDING
        return (
            super()._turning_price()
            + p.rate_weight * squares
            + p.change_weight * change
            + p.sharp_weight * sharp[:, None]
        )

    def _costs(
        self, observation: Observation, rows: NDArray[np.int64], every: bool
    ) -> NDArray[np.float64]:
        p, (v, w) = self._careful, self._actions.T
        last = self._commands[rows]
        variance = observation.goal[:, 3:].astype(np.float64).sum(axis=1)
        turning = price_of_turning(np.nan_to_num(variance, nan=0.0, posinf=1e6), p)
        start = np.zeros((len(last), len(w)))
        if p.hears_commands:
            start += turning[:, None] * p.change_weight * np.abs(w - last[:, -1:, 1])
        start += p.wait_weight * _hidden_share(observation)[:, None] * np.abs(v)
        start[:, self._stand] += p.stand_weight
        start += p.slow_weight * (v.max() - v)
        goals = observation.goal[:, :2].astype(np.float64)
        for k in range(1, self._delay + 1 if p.hears_commands else 1):
            goals = moved_on(goals, last[:, k], self._period)
        return self._decide(observation, every, goals, turning, start, rows)


def price_of_turning(variance: NDArray[np.float64], p: CarefulConfig) -> NDArray[np.float64]:
    """Factor (B,) on what turning costs, by the sum of the belief's variances (B,), m² + rad².

    Least while the cloud is wide, as at the start: then some of it has slipped as the robot has,
    and the filter follows. A cloud that has settled is left behind. Much wider ones are several
    clouds, which a turn must not decide between.
    """
    wide = np.maximum(variance, p.settled_variance) / p.settled_variance
    return 1.0 / (wide * wide) + p.doubt_weight * variance


def _hidden_share(observation: Observation) -> NDArray[np.float64]:
    """Share of the half circle in front that people hide, at most, (B,)."""
    place = np.nan_to_num(observation.pedestrians[..., :2].astype(np.float64))
    x, y = np.moveaxis(place, -1, 0)
    there = np.arange(x.shape[1]) < observation.pedestrian_count[:, None]
    angle = 2.0 * np.arctan2(_PERSON, np.maximum(np.hypot(x, y), _PERSON)) / np.pi
    return np.minimum(np.where(there & (x > 0.0), angle, 0.0).sum(axis=1), 1.0)


def moved_on(
    goals: NDArray[np.float64], command: NDArray[np.float64], period: float
) -> NDArray[np.float64]:
    """``goals`` (B, 2), m in the robot frame, after ``period`` s of ``command`` (B, 2)."""
    v, w = command.T
    half = 0.5 * w * period
    chord = v * period * np.sinc(half / np.pi)
    x, y = goals[:, 0] - chord * np.cos(half), goals[:, 1] - chord * np.sin(half)
    cosine, sine = np.cos(2.0 * half), np.sin(2.0 * half)
    return np.stack((cosine * x + sine * y, cosine * y - sine * x), axis=1)
