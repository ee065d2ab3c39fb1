"""What a teacher says of the states that are met, and what it drives."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from actors.rollout import Rollout
from actors.teaching import Teacher
from lndrl.errors import UserError
from lndrl.navigation import Trajectory, VectorNavigation, action_table
from lndrl.navigation.families import first_world_of_actor
from lndrl.navigation.trajectory import MOST_COST
from lndrl.planners import PredictivePlanner, planner_source
from lndrl.policy import Guidance, build_policy, initial_weights, to_bytes


def weights(config, **guidance) -> bytes:
    torch.manual_seed(1)
    return to_bytes(build_policy(config), Guidance(**guidance).to_metadata())


@pytest.fixture
def rollout(small_config):
    def build(teacher: str = "predictive", **guidance) -> Rollout:
        config = small_config(ppo={"teacher": teacher}, localization={"delay": 1})
        made = Rollout(config, 2)
        made.load(0, weights(config, **guidance))
        return made

    return build


def collected(actor: Rollout, number: int = 0) -> Trajectory:
    chunk = actor.collect(number)
    assert chunk is not None
    return chunk.trajectory


def labels_of(trajectory: Trajectory) -> NDArray[np.float16]:
    assert trajectory.teacher is not None
    return trajectory.teacher


@pytest.mark.parametrize("name", ["predictive", "careful"])
def test_labels_are_the_planners_costs_in_the_states_met(rollout, name: str) -> None:
    """Also those that depend on what the robot was told, and across the ends of episodes."""
    actor = rollout(name, labels=True)
    chunks = [collected(actor, i) for i in range(6)]
    config = actor.config
    planner = planner_source(name).build(config)
    assert isinstance(planner, PredictivePlanner)
    planner.reset(0, range(2))
    actions, ended = action_table(config.task), 0
    replay = VectorNavigation(config, first_world_of_actor(2), 2)
    for chunk in chunks:
        for t in range(8):
            costs = planner.costs(replay.observation, np.arange(2))
            above = np.minimum(costs - costs.min(axis=1, keepdims=True), MOST_COST)
            np.testing.assert_array_equal(labels_of(chunk)[t], above.astype(np.float16))
            result = replay.step(chunk.action[t])
            if name == "careful":
                planner.told(actions[chunk.action[t]], np.arange(2))
                planner.begin(np.flatnonzero(result.terminated | result.truncated))
            ended += len(result.episodes)
    assert ended, "an episode must end on the way"


def test_a_command_that_was_told_changes_what_careful_says(small_config) -> None:
    config = small_config(ppo={"teacher": "careful"})
    worlds = VectorNavigation(config, 0, 2)
    teacher = Teacher(config, 2)
    teacher.begin(3, Guidance(labels=True), np.random.default_rng(0))
    fastest = np.full(2, len(action_table(config.task)) - 1)
    nobody = np.zeros(2, bool)
    for t, ended in enumerate((nobody, ~nobody, nobody)):
        teacher.teach(t, worlds.observation)
        teacher.told(fastest, ended)
    first, after, anew = teacher.labels()
    assert (first != after).any()
    np.testing.assert_array_equal(first, anew)


def test_without_guidance_nothing_is_labelled_or_driven(rollout) -> None:
    actor = rollout()
    trajectory = collected(actor)
    assert labels_of(trajectory).shape == (0, 2, 28)
    plain = Rollout(
        actor.config.model_copy(
            update={"ppo": actor.config.ppo.model_copy(update={"teacher": None})}
        ),
        2,
    )
    plain.load(0, weights(plain.config))
    same = collected(plain)
    np.testing.assert_array_equal(trajectory.action, same.action)
    assert same.teacher is None and "teacher" not in same.to_arrays()


def test_labelling_does_not_change_what_the_policy_does(rollout) -> None:
    one, two = (collected(rollout(labels=labels)) for labels in (False, True))
    np.testing.assert_array_equal(one.action, two.action)
    np.testing.assert_array_equal(one.log_prob, two.log_prob)


def test_a_world_that_the_teacher_drives_takes_its_cheapest_action(rollout) -> None:
    actor = rollout(labels=True, drives=1.0)
    trajectory = collected(actor)
    cheapest = np.take_along_axis(
        labels_of(trajectory), trajectory.action[..., None].astype(np.int64), axis=2
    )
    assert (cheapest == 0.0).all()
    # What is uploaded beside it is what the policy says of that action.
    actor.environment = VectorNavigation(actor.config, first_world_of_actor(2), 2)
    said = actor.runner.log_probabilities(trajectory.observation.take(0))
    expected = np.take_along_axis(said, trajectory.action[0][:, None].astype(np.int64), 1)[:, 0]
    np.testing.assert_allclose(trajectory.log_prob[0], expected, rtol=1e-5)
    arrays = trajectory.to_arrays()
    read = labels_of(Trajectory.from_arrays(arrays, actor.config))
    np.testing.assert_array_equal(read, labels_of(trajectory))


def test_the_share_that_is_driven(small_config) -> None:
    """Of 4,000 worlds 0.3 are, within 5 standard errors."""
    config = small_config(ppo={"teacher": "predictive"})
    teacher = Teacher(config, 4000)
    teacher.begin(1, Guidance(labels=True, drives=0.3), np.random.default_rng(0))
    assert teacher._driven.mean() == pytest.approx(0.3, abs=5 * np.sqrt(0.21 / 4000))


def test_a_goal_that_is_no_number_leaves_all_actions_alike(small_config) -> None:
    config = small_config(ppo={"teacher": "predictive"})
    worlds = VectorNavigation(config, 0, 2)
    worlds.observation.goal[0, 0] = np.nan
    teacher = Teacher(config, 2)
    teacher.begin(1, Guidance(labels=True), np.random.default_rng(0))
    teacher.teach(0, worlds.observation)
    assert (teacher.labels()[0, 0] == 0.0).all() and (teacher.labels()[0, 1] > 0.0).any()


def test_settings_that_the_teacher_does_not_have(small_config) -> None:
    config = small_config(ppo={"teacher": "predictive"}, imitation={"settings": {"speed": 3}})
    with pytest.raises(UserError, match=r"imitation\.settings of the teacher predictive.*speed"):
        Teacher(config, 1)


def test_guidance_travels_with_the_weights(small_config) -> None:
    config = small_config()
    assert Guidance.of(weights(config, labels=True, drives=0.25)) == Guidance(True, 0.25)
    assert Guidance.of(initial_weights(config)) == Guidance()


@pytest.mark.parametrize("said", ['{"labels": 1}', '{"drives": 2.0}', '{"drive": 0}', "[]", "{"])
def test_guidance_that_makes_no_sense_is_refused(small_config, said: str) -> None:
    from lndrl.policy.weights import GUIDANCE_KEY

    blob = to_bytes(build_policy(small_config()), {GUIDANCE_KEY: said})
    with pytest.raises(UserError, match="guidance that cannot be read"):
        Guidance.of(blob)
