"""A planner behind the guard: what it keeps, what it takes instead, what it knows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lndrl.config import RunConfig
from lndrl.navigation import Observation, action_table
from lndrl.planners import (
    DWAPlanner,
    GuardConfig,
    GuardedPlanner,
    PredictivePlanner,
    StraightPlanner,
    planner_source,
)
from lndrl.world import Place
from tests.lndrl.planners.seen import BEAMS, BEARINGS, seen, wall_ahead

ROWS = np.arange(1)


@pytest.fixture(scope="module")
def config() -> RunConfig:
    scenario = {
        "name": "room",
        "size": [8, 8],
        "pedestrians": {"count": [0, 0]},
        "robot": [{"start": [1, 1, 2, 2], "goal": [6, 6, 7, 7]}],
    }
    return RunConfig.model_validate({"scenario": scenario})


class Ranked:
    """A policy's double: ranks the actions as it is told."""

    name = "ranked"

    def __init__(self, config: RunConfig, order: list[int]) -> None:
        self.order, self.actions = order, action_table(config.task)

    def reset(self, seed: int, worlds: list[int]) -> None:
        """Nothing to reset."""

    def act(self, observation: Observation, rows: np.ndarray) -> np.ndarray:
        return self.actions[self.scores(observation, rows).argmax(axis=1)]

    def scores(self, observation: Observation, rows: np.ndarray) -> np.ndarray:
        scores = np.full((len(observation), len(self.actions)), -100.0)
        scores[:, self.order] = -np.arange(len(self.order))
        return scores


def post(x: float, y: float, radius: float = 0.1) -> np.ndarray:
    """Ranges of a round thing at x, y (m) and nothing else."""
    along = x * np.cos(BEARINGS) + y * np.sin(BEARINGS)
    inside = radius**2 - (x * x + y * y - along**2)
    hit = along - np.sqrt(np.maximum(inside, 0.0))
    return np.where((inside > 0.0) & (hit > 0.0), hit, 12.0)


def guarded(planner, config: RunConfig, **bounds) -> GuardedPlanner:
    made = GuardedPlanner(planner, config, GuardConfig(**bounds))
    made.reset(0, [0])
    return made


def test_where_nothing_is_near_it_is_the_planner(config: RunConfig) -> None:
    for plain in (PredictivePlanner(config), DWAPlanner(config), StraightPlanner(config)):
        planner = guarded(plain, config)
        assert planner.name == f"{plain.name}+guard"
        for goal in ((6.0, 0.0), (1.0, 3.0), (-3.0, 0.5)):
            plain.reset(0, [0])
            expected = plain.act(seen(goal), ROWS)
            np.testing.assert_array_equal(planner.act(seen(goal), ROWS), expected)
        assert planner.vetoes.tolist() == [0]


def test_the_best_that_is_safe_is_taken(config: RunConfig) -> None:
    table = action_table(config.task)
    fast, slow, turn = (
        int(np.flatnonzero((table == each).all(axis=1))[0])
        for each in ((0.6, 0.0), (0.2, 0.0), (0.0, 0.9))
    )
    planner = guarded(Ranked(config, [fast, turn, slow]), config)
    told = planner.act(seen((6.0, 0.0), post(1.1, 0.0)), ROWS)[0]
    assert told.tolist() == [0.0, 0.9]  # slowly would be safe as well, and is liked less
    planner = guarded(Ranked(config, [fast, slow, turn]), config)
    assert planner.act(seen((6.0, 0.0), post(1.1, 0.0)), ROWS)[0].tolist() == [0.2, 0.0]
    assert planner.vetoes.tolist() == [1]


def test_a_blind_planner_stops_before_a_body(config: RunConfig) -> None:
    planner = guarded(StraightPlanner(config), config)
    away, told = 3.0, (0.0, 0.0)
    for _ in range(20):
        told = planner.act(seen((6.0, 0.0), post(away, 0.0)), ROWS)[0]
        away -= 0.4 * told[0] * math.cos(told[1])
    assert away - 0.1 - 0.17 > 0.4 and told[0] == 0.0 and planner.vetoes[0] > 5


def test_what_the_map_shows_may_be_neared(config: RunConfig) -> None:
    """With the place and the pose a wall is a wall; without them it may be anything."""
    place = Place.build(config.scenario)
    wall, pose = wall_ahead(0.9), np.array([[6.9, 4.0, 0.0]])
    wall = np.minimum(wall, 4.0 / np.maximum(np.abs(np.sin(BEARINGS)), 1e-6))
    assert wall.shape == (BEAMS,)
    for knows, expected in ((True, 0.6), (False, 0.0)):
        planner = guarded(StraightPlanner(config), config)
        if knows:
            planner.enter([place])
            planner.hear(pose, ROWS)
        assert planner.act(seen((6.0, 0.0), wall), ROWS)[0, 0] == expected
    # A pose that is elsewhere explains nothing, so nothing is taken for a wall.
    planner.enter([place])
    planner.hear(np.array([[3.0, 3.0, 1.0]]), ROWS)
    assert planner.act(seen((6.0, 0.0), wall), ROWS)[0, 0] == 0.0


def test_a_pose_that_is_heard_late_is_moved_on(config: RunConfig) -> None:
    late = config.model_copy(
        update={"localization": config.localization.model_copy(update={"delay": 2})}
    )
    place = Place.build(late.scenario)
    planner = guarded(StraightPlanner(late), late, map_tolerance=0.1)
    planner.enter([place])
    x = 5.5
    for step in range(4):
        heard = 5.5 if step < 2 else 5.5 + 0.24 * (step - 2)
        planner.hear(np.array([[heard, 4.0, 0.0]]), ROWS)
        wall = np.minimum(wall_ahead(7.9 - x), 3.9 / np.maximum(np.abs(np.sin(BEARINGS)), 1e-6))
        told = planner.act(seen((6.0, 0.0), wall), ROWS)[0]
        assert told.tolist() == [0.6, 0.0], step  # the walls are where the map has them
        x += 0.24


def test_brakes_are_minded(config: RunConfig) -> None:
    world = config.world.model_validate({"robot": {"acceleration": {"linear": 0.5}}})
    slow = config.model_copy(update={"world": world})
    stops = []
    for each in (config, slow):
        planner, away, speed = guarded(StraightPlanner(each), each), 4.0, 0.0
        for _ in range(40):
            told = planner.act(seen((6.0, 0.0), post(away, 0.0)), ROWS)[0]
            for _ in range(4):
                limit = math.inf if each is config else 0.05
                speed += max(-limit, min(limit, told[0] - speed))
                away -= 0.1 * speed
        assert speed == 0.0
        stops.append(away)
    assert stops[1] > 0.1 + 0.17 + 0.4 and stops[0] > 0.1 + 0.17 + 0.4


def test_it_is_built_from_a_source(config: RunConfig) -> None:
    source = planner_source("predictive", guard=GuardConfig(people_speed=1.0))
    assert source.title == source.label == "predictive+guard"
    planner = source.build(config)
    assert isinstance(planner, GuardedPlanner) and planner.parameters.people_speed == 1.0
    assert planner_source("my.module:Thing", guard=GuardConfig()).label == "Thing+guard"


def test_without_a_goal_it_stands(config: RunConfig) -> None:
    planner = guarded(PredictivePlanner(config), config)
    assert planner.act(seen((math.nan, 0.0)), ROWS)[0].tolist() == [0.0, 0.0]
