"""Planners that look ahead with a robot that cannot change its velocities at once."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lndrl.config import RunConfig
from lndrl.navigation import action_table
from lndrl.planners import CarefulPlanner, PredictivePlanner
from lndrl.planners.rollouts import limited_rollouts, make_rollouts
from lndrl.world.odometry import accelerate, drive
from tests.lndrl.planners.seen import seen, wall_ahead

ROWS = np.arange(1)
LIMITS = (1.0, 1.0, 2.0)


@pytest.fixture(scope="module")
def limited(config: RunConfig) -> RunConfig:
    world = config.world.model_validate({"robot": "turtlebot2"})
    return config.model_copy(update={"world": world})


def test_rollouts_are_where_the_world_drives(config: RunConfig) -> None:
    actions = action_table(config.task)
    first, second = np.array([0.2, 0.4, 0.8]), np.array([0.4, 1.2])
    price = np.zeros((28, 28))
    made = limited_rollouts(actions, first, second, price, np.array([0.4, -0.3]), LIMITS, 0.1)
    for i, j in ((0, 27), (27, 0), (13, 5)):
        pose, velocity = np.zeros(3), np.array([0.4, -0.3])
        at = {}
        for tick in range(1, 21):
            command = actions[i] if tick <= 8 else actions[j]
            accelerate(velocity, command, LIMITS, 0.1)
            drive(pose, velocity[0], velocity[1], 0.1)
            at[tick] = pose.copy()
        for k, tick in enumerate((2, 4, 8)):
            assert made.first[i, k] == pytest.approx(at[tick][:2], abs=1e-9)
        for k, tick in enumerate((12, 20)):
            assert made.second[i, j, k] == pytest.approx(at[tick][:2], abs=1e-9)
        assert math.cos(made.end[i, j, 2] - at[20][2]) == pytest.approx(1.0)


def test_without_limits_they_are_the_plain_ones(config: RunConfig) -> None:
    actions = action_table(config.task)
    first, second, price = np.array([0.2, 0.8]), np.array([0.3, 2.4]), np.ones((28, 28))
    plain = make_rollouts(actions, first, second, price)
    free = (math.inf, math.inf, math.inf)
    same = limited_rollouts(actions, first, second, price, np.array([0.6, 0.9]), free, 0.1)
    for one, other in zip(plain, same, strict=True):
        assert other == pytest.approx(one, abs=1e-9)


def stopping(planner: PredictivePlanner, limits: tuple[float, float, float] | None) -> float:
    """How near a planner comes to a wall right before which its goal lies (m, from the middle)."""
    planner.reset(0, [0])
    away, velocity, pose = 3.0, np.zeros(2), np.zeros(3)
    nearest = away
    for _ in range(40):
        command = planner.act(seen((away - pose[0] - 0.25, 0.0), wall_ahead(away - pose[0])), ROWS)
        command = command[0] * (1.0, 0.0)  # keep it on the line
        for _ in range(4):
            accelerate(velocity, command, limits or (math.inf,) * 3, 0.1)
            drive(pose, velocity[0], velocity[1], 0.1)
        nearest = min(nearest, away - pose[0])
    return nearest


def test_it_brakes_in_time(config: RunConfig) -> None:
    world = config.world.model_validate(
        {"robot": {"acceleration": {"linear": 1.0, "braking": 0.25}}}
    )
    weak = config.model_copy(update={"world": world})
    assert stopping(PredictivePlanner(weak), (1.0, 0.25, math.inf)) > 0.17
    # As a control: who does not know its brakes touches the wall.
    assert stopping(PredictivePlanner(config), (1.0, 0.25, math.inf)) < 0.17


@pytest.mark.parametrize("kind", [PredictivePlanner, CarefulPlanner])
def test_what_it_does_follows_from_how_fast_it_is(
    kind: type[PredictivePlanner], limited: RunConfig
) -> None:
    fast, standing = kind(limited), kind(limited)
    for planner in (fast, standing):
        planner.reset(0, [0])
    for _ in range(3):
        fast.told(np.array([[0.6, 0.0]]), ROWS)
        standing.told(np.array([[0.0, 0.0]]), ROWS)
    there = seen((6.0, 0.0), wall_ahead(0.6))
    quick, calm = fast.costs(there, ROWS)[0], standing.costs(there, ROWS)[0]
    straight = int(np.flatnonzero((action_table(limited.task) == (0.6, 0.0)).all(axis=1))[0])
    assert quick[straight] > calm[straight]
    fast.begin(ROWS)
    if kind is PredictivePlanner:
        np.testing.assert_array_equal(fast.costs(there, ROWS)[0], calm)


def test_many_rows_are_each_for_itself(limited: RunConfig) -> None:
    planner = PredictivePlanner(limited)
    planner.reset(0, [0, 1, 2])
    rows = np.arange(3)
    planner.told(np.array([[0.6, 0.0], [0.0, 0.9], [0.0, 0.0]]), rows)
    several = seen((3.0, 1.0), wall_ahead(1.2)).take(np.zeros(3, np.int64))
    together = planner.costs(several, rows)
    for row in range(3):
        alone = planner.costs(several.take(np.array([row])), np.array([row]))
        np.testing.assert_array_equal(alone[0], together[row])
    assert not np.array_equal(together[0], together[2])
