from __future__ import annotations

import math

import numpy as np
import pytest

from lndrl.config import RunConfig
from lndrl.navigation import Observation, action_table
from lndrl.planners import RandomPlanner, StraightPlanner, episode_generator

STEP = 0.4


def seen(goals: list[tuple[float, float]]) -> Observation:
    observation = Observation.zeros(len(goals))
    observation.goal[:, :2] = goals
    # Everything else must not matter.
    observation.goal[:, 2:] = np.random.default_rng(0).normal(size=(len(goals), 4))
    observation.scan[:] = 7
    return observation


def rows(count: int) -> np.ndarray:
    return np.arange(count)


def test_random_is_uniform_over_the_action_table(config: RunConfig) -> None:
    table = action_table(config.task)
    planner = RandomPlanner(config)
    planner.reset(3, range(40))
    counts = np.zeros(len(table))
    for _ in range(140):
        drawn = planner.act(seen([(1, 0)] * 40), rows(40))
        matches = (drawn[:, None] == table[None]).all(axis=2)
        assert (matches.sum(axis=1) == 1).all()
        counts += matches.sum(axis=0)
    expected = counts.sum() / len(table)  # 200 each
    chi_squared = ((counts - expected) ** 2 / expected).sum()
    assert chi_squared < 55.5  # 99.9 % quantile at 27 degrees of freedom


def test_random_draws_of_a_world_do_not_depend_on_its_neighbours(config: RunConfig) -> None:
    together, alone, other = (RandomPlanner(config) for _ in range(3))
    together.reset(5, [10, 11, 12])
    alone.reset(5, [11])
    other.reset(6, [11])
    first, second, third = [], [], []
    for step in range(30):
        # Row 0 ends after ten steps: rows then name who is left.
        left = rows(3) if step < 10 else np.array([1, 2])
        actions = together.act(seen([(1, 0)] * len(left)), left)
        first.append(actions[list(left).index(1)])
        second.append(alone.act(seen([(1, 0)]), rows(1))[0])
        third.append(other.act(seen([(1, 0)]), rows(1))[0])
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(second, third)


def test_generators_of_worlds_and_seeds_differ() -> None:
    draws = [episode_generator(s, w).random() for s in range(3) for w in range(3)]
    assert len(set(draws)) == 9
    assert episode_generator(1, 2).random() == draws[5]


@pytest.mark.parametrize(
    ("goal", "expected"),
    [
        ((5.0, 0.0), (0.6, 0.0)),
        ((5.0, 0.5), (0.6, math.atan2(0.5, 5.0) / STEP)),
        ((5.0, -0.5), (0.6, -math.atan2(0.5, 5.0) / STEP)),
        ((5.0, 4.0), (0.6, 0.9)),
        ((0.0, 3.0), (0.0, 0.9)),
        ((-1.0, -0.1), (0.0, -0.9)),
    ],
)
def test_straight_turns_left_for_a_goal_on_the_left(
    config: RunConfig, goal: tuple[float, float], expected: tuple[float, float]
) -> None:
    planner = StraightPlanner(config)
    planner.reset(0, [0])
    np.testing.assert_allclose(planner.act(seen([goal]), rows(1)), [expected], atol=1e-7)


def test_straight_reaches_every_goal_in_an_empty_plane(config: RunConfig) -> None:
    planner = StraightPlanner(config)
    planner.reset(0, range(16))
    angles = np.linspace(-math.pi, math.pi, 16)
    goal = np.stack([10 * np.cos(angles), 10 * np.sin(angles)], axis=1)
    pose = np.zeros((16, 3))
    for _ in range(60):
        offset = goal - pose[:, :2]
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        local = np.stack([c * offset[:, 0] + s * offset[:, 1], c * offset[:, 1] - s * offset[:, 0]])
        velocities = planner.act(seen([tuple(p) for p in local.T]), rows(16))
        assert (velocities[:, 0] <= 0.6).all() and (np.abs(velocities[:, 1]) <= 0.9).all()
        turn = velocities[:, 1] * STEP
        pose[:, 2] += turn / 2
        pose[:, 0] += velocities[:, 0] * STEP * np.cos(pose[:, 2])
        pose[:, 1] += velocities[:, 0] * STEP * np.sin(pose[:, 2])
        pose[:, 2] += turn / 2
        done = np.hypot(*(goal - pose[:, :2]).T) < 0.5
        if done.all():
            return
        goal[done] = pose[done, :2]  # arrived: stay
    pytest.fail("some goals were not reached in 24 s")
