"""A trained policy on Gymnasium's observations is the product's own policy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import lndrl
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.navigation.environment.spaces import observation_dict
from lndrl.policy import (
    POLICY_FILE,
    NavigationNetwork,
    PolicyRunner,
    build_policy,
    policy_metadata,
    to_bytes,
)
from tests.lndrl.policy.test_networks import make_config, random_observation

SMALL = {"map_channels": (4, 4, 4), "features": 16, "goal_features": 4}
CONFIGS = {
    "sparse": make_config(**SMALL),
    "unpooled": make_config(**SMALL, pooling="none"),
    "no_map": make_config(**SMALL, pedestrian_map=False),
    "no_variances": make_config(**SMALL, variances=False),
}


def written(config: RunConfig, folder: Path) -> tuple[Path, bytes]:
    """A policy file, whose head is far from uniform, and the weights in it."""
    network = build_policy(config)
    assert isinstance(network, NavigationNetwork)
    network.head.weight.data.mul_(100.0)
    blob = to_bytes(network, policy_metadata(config, 1, 2))
    file = folder / POLICY_FILE
    file.write_bytes(blob)
    return file, blob


@pytest.mark.parametrize("kind", list(CONFIGS))
def test_equals_the_policy_that_sees_people(kind: str, tmp_path: Path) -> None:
    config = CONFIGS[kind]
    file, blob = written(config, tmp_path)
    runner = PolicyRunner(config)
    runner.load(blob)
    policy = lndrl.load_policy(file)
    assert policy.config == config
    for seed in range(3):
        people = random_observation(np.random.default_rng(seed), 40, 1.0)
        drawn = observation_dict(people, config.task)
        expected = runner.log_probabilities(people)
        found = policy.log_probabilities(drawn)
        assert found.dtype == np.float32 and expected.std() > 0.1
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(policy.act(drawn, greedy=True), expected.argmax(1))
        cold = policy.act(drawn, temperature=1e-6)
        np.testing.assert_array_equal(cold, expected.argmax(1))
        one = {name: rows[7] for name, rows in drawn.items()}
        np.testing.assert_allclose(policy.log_probabilities(one), expected[7], atol=1e-5)


def test_a_map_that_has_no_sparse_evaluation_is_read_densely(tmp_path: Path) -> None:
    config = make_config(**SMALL)
    config = config.model_copy(update={"task": config.task.model_copy(update={"map_cells": 20})})
    file, blob = written(config, tmp_path)
    runner = PolicyRunner(config)
    runner.load(blob)
    people = random_observation(np.random.default_rng(1), 8, 1.0)
    found = lndrl.load_policy(file).log_probabilities(observation_dict(people, config.task))
    np.testing.assert_array_equal(found, runner.log_probabilities(people))


def test_one_and_many_as_the_environments_show_them(tmp_path: Path) -> None:
    config = make_config(**SMALL)
    file, _ = written(config, tmp_path)
    policy = lndrl.load_policy(tmp_path, seed=1)
    env = gymnasium.make("lndrl/Navigation-v0", config=policy.config)
    observation, _ = env.reset(seed=1)
    action = policy.act(observation)
    assert env.action_space.contains(action)
    env.step(action)
    envs = gymnasium.make_vec("lndrl/Navigation-v0", 3, config=policy.config)
    observations, _ = envs.reset(seed=1)
    actions = policy.act(observations)
    assert actions.shape == (3,) and envs.action_space.contains(actions)
    envs.step(actions)
    drawn = [policy.act(observation) for _ in range(30)]
    assert len(set(drawn)) > 1
    again = lndrl.load_policy(file, seed=1)
    again.act(observation), again.act(observations)
    assert [again.act(observation) for _ in range(30)] == drawn


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"scan": np.zeros((1, 360), np.float32)}, r"scan must have the shape \(1, 720\)"),
        ({"goal": np.zeros((2, 6), np.float32)}, "scan must have the shape"),
        ({"goal": np.zeros((1, 1, 6), np.float32)}, "for a batch"),
        ({"pedestrians": np.zeros((3, 20, 20), np.float32)}, "pedestrians must have the shape"),
        (None, "an observation is a dict with scan, pedestrians, goal"),
    ],
)
def test_other_observations_are_refused(
    change: dict[str, Any] | None, says: str, tmp_path: Path
) -> None:
    written(make_config(**SMALL), tmp_path)
    policy = lndrl.load_policy(tmp_path)
    observation = {
        "scan": np.zeros((1, 720), np.float32),
        "pedestrians": np.zeros((3, 48, 48), np.float32),
        "goal": np.zeros(6, np.float32),
    }
    policy.act(observation)
    with pytest.raises(ValueError, match=says):
        policy.act({"scan": observation["scan"]} if change is None else observation | change)


def test_nothing_usable_is_said(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds no checkpoint yet"):
        lndrl.load_policy(tmp_path)
