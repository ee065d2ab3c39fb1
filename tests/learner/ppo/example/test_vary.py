"""Varied states: near those that were met, possible, and labelled for what they are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from learner.ppo.batch import assemble
from learner.ppo.example.lessons import Lessons
from learner.ppo.example.vary import Variations
from lndrl.config import RunConfig, load_config
from lndrl.navigation import Observation
from lndrl.navigation.trajectory import MOST_COST
from lndrl.planners import teacher_of
from tests.learner.helpers_learner import random_trajectory, small_config

FORGETFUL: dict[str, object] = {"hears_commands": False, "change_weight": 0.0}
TEACHERS: list[tuple[str, dict[str, object]]] = [("predictive", {}), ("careful", FORGETFUL)]


def config_of(teacher: str, settings: dict[str, object], **plan: object) -> RunConfig:
    return small_config(
        ppo={"teacher": teacher}, imitation={"settings": settings, "mirror": False, **plan}
    )


def met(config: RunConfig, states: int = 60) -> Observation:
    return random_trajectory(config, 3, steps=states, worlds=1).observation.flatten()


@pytest.mark.parametrize(("teacher", "settings"), TEACHERS)
def test_labels_are_what_the_teacher_says_of_the_varied_state(
    teacher: str, settings: dict[str, object]
) -> None:
    config = config_of(teacher, settings)
    before = met(config)
    seen = before.copy()
    labels = Variations(config)(seen, np.random.default_rng(1))
    assert labels.shape == (60, 28) and labels.dtype == np.float16
    assert (labels.min(axis=1) == 0.0).all() and labels.max() <= MOST_COST
    asked = teacher_of(config)
    asked.reset(9, list(range(60)))
    costs = asked.costs(seen, np.arange(60))
    above = np.minimum(costs - costs.min(axis=1, keepdims=True), MOST_COST)
    np.testing.assert_allclose(labels, above, rtol=1e-3, atol=1e-3)
    old = asked.costs(before, np.arange(60))
    assert (old.argmin(axis=1) != costs.argmin(axis=1)).any(), "they are other states"


def test_a_varied_state_is_a_possible_observation() -> None:
    config = config_of("predictive", {})
    before = met(config, 400)
    # Some of them stand where the map ends.
    half = 0.5 * config.task.map_extent
    before.pedestrians[:, 0, :2] = np.random.default_rng(1).uniform(-half, half, (400, 2))
    before.goal[:, 3:] = 0.9 * config.task.variance_limit
    seen = before.copy()
    Variations(config)(seen, np.random.default_rng(2))
    assert (seen.scan == before.scan).all()
    people, count = seen.pedestrians, seen.pedestrian_count.astype(int)
    there = np.arange(people.shape[1]) < count[:, None]
    assert (people[~there] == 0.0).all()
    assert (np.abs(people[..., :2]) <= half).all()
    distance = np.where(there, np.hypot(people[..., 0], people[..., 1]), np.inf)
    assert (np.diff(np.where(np.isinf(distance), 1e9, distance), axis=1) >= 0.0).all()
    assert (count > before.pedestrian_count).any() and (count < before.pedestrian_count).any()
    assert (seen.goal[:, 3:] <= config.task.variance_limit).all() and (seen.goal[:, 3:] >= 0).all()
    # Where the goal is, is moved by a turn whose cosine is 0.73 on average; not thrown anywhere.
    towards = (seen.goal[:, :2] * before.goal[:, :2]).sum(axis=1)
    lengths = np.hypot(*seen.goal[:, :2].T) * np.hypot(*before.goal[:, :2].T)
    assert np.mean(towards / lengths) == pytest.approx(np.exp(-0.5 * 0.8**2), abs=0.1)


def test_a_map_may_be_as_small_as_one_likes() -> None:
    config = config_of("predictive", {})
    task = config.task.model_copy(update={"map_extent": 0.8})
    config = config.model_copy(update={"task": task})
    seen = met(config)
    Variations(config)(seen, np.random.default_rng(2))
    assert (np.abs(seen.pedestrians[..., :2]) <= 0.4).all()


def test_the_same_draws_vary_alike() -> None:
    config = config_of("predictive", {})
    labels = [Variations(config)(met(config), np.random.default_rng(5)) for _ in range(2)]
    assert (labels[0] == labels[1]).all()


def test_a_share_of_the_lessons_is_varied() -> None:
    def draw(share: float) -> float:
        config = config_of("predictive", {}, vary=share)
        lessons = Lessons(config)
        trajectory = random_trajectory(config, 3, steps=200, worlds=1)
        lessons.add(assemble([trajectory]))
        goals = {goal.tobytes() for goal in trajectory.observation.goal.reshape(-1, 6)}
        found = lessons.draw(400, np.random.default_rng(4)).observation.goal
        return float(np.mean([goal.tobytes() not in goals for goal in found]))

    assert draw(0.0) == 0.0 and draw(1.0) == 1.0
    assert draw(0.25) == pytest.approx(0.25, abs=0.09)  # four deviations


def test_a_teacher_with_a_memory_cannot_be_asked_about_what_nobody_met() -> None:
    misfit: Callable[[list[str]], str | None] = lambda sets: load_config(  # noqa: E731
        "lndrl", sets
    ).teacher_misfit()
    assert misfit(["imitation.vary=0.5"]) is None
    assert misfit(["imitation.vary=0.5", "ppo.teacher=predictive", "imitation.settings={}"]) is None
    said = misfit(["imitation.vary=0.5", "imitation.settings={}"])
    assert said is not None and "hears_commands: false" in said
    # Nor about one whose velocities take time: a state that nobody met has no speed.
    said = misfit(["imitation.vary=0.5", "world.robot=turtlebot2"])
    assert said is not None and "say imitation.vary: 0" in said
    assert misfit(["world.robot=turtlebot2"]) is None
    assert load_config("shipped-robot").teacher_misfit() is None
