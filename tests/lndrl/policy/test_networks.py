"""The paper's networks, and the sparse encoder against the dense one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.config import NetworkConfig, RunConfig
from lndrl.navigation import Observation, draw_pedestrian_map
from lndrl.policy import Inputs, NavigationNetwork, build_policy, build_value, prepare
from lndrl.scenario import Scenario


def make_config(**network: object) -> RunConfig:
    scenario = Scenario.model_validate(
        {
            "name": "empty",
            "size": [10, 10],
            "pedestrians": {"count": [0, 0]},
            "robot": [{"start": [1, 1, 2, 2], "goal": [8, 8, 9, 9]}],
        }
    )
    return RunConfig(scenario=scenario, network=NetworkConfig.model_validate(network))


def random_observation(rng: np.random.Generator, samples: int, people: float) -> Observation:
    observation = Observation.zeros(samples)
    observation.scan[:] = rng.integers(0, 65536, observation.scan.shape)
    observation.goal[:] = rng.normal(size=observation.goal.shape)
    observation.pedestrian_count[:] = np.minimum(rng.poisson(people, samples), 24)
    shape = (samples, 24, 2)
    observation.pedestrians[..., :2] = rng.uniform(-3, 3, shape)
    observation.pedestrians[..., 2:] = rng.uniform(-0.5, 0.5, shape)
    return observation


def dense(observation: Observation, config: RunConfig) -> Inputs:
    maps = draw_pedestrian_map(observation.pedestrians, observation.pedestrian_count, config.task)
    return replace(prepare(observation, config), people=torch.from_numpy(maps))


def with_random_biases(network: NavigationNetwork) -> NavigationNetwork:
    """Zero biases would hide every mistake about the response to an empty map."""
    for parameter in network.parameters():
        if parameter.ndim == 1:
            torch.nn.init.normal_(parameter, std=0.2)
    return network


@pytest.fixture(scope="module")
def config() -> RunConfig:
    return make_config(map_channels=(8, 12, 16), features=32, goal_features=8)


@pytest.fixture(scope="module")
def network(config: RunConfig) -> NavigationNetwork:
    torch.manual_seed(3)
    return with_random_biases(build_policy(config))


def test_papers_parameter_counts() -> None:
    config = make_config(initialization="default")
    assert sum(p.numel() for p in build_policy(config).parameters()) == 7_615_804
    assert sum(p.numel() for p in build_value(config).parameters()) == 7_601_953


def test_without_pooling_the_map_keeps_its_size() -> None:
    config = make_config(pooling="none", map_channels=(2, 2, 2), features=8)
    network = build_policy(config)
    assert network.map_encoder.linear.in_features == 2 * 48 * 48
    observation = random_observation(np.random.default_rng(0), 3, 1.0)
    assert network(prepare(observation, config)).shape == (3, 28)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), people=st.sampled_from([0.0, 0.5, 2.0, 8.0, 30.0]))
def test_sparse_equals_dense(
    config: RunConfig, network: NavigationNetwork, seed: int, people: float
) -> None:
    observation = random_observation(np.random.default_rng(seed), 5, people)
    with torch.no_grad():
        sparse = network(prepare(observation, config))
        reference = network(dense(observation, config))
    torch.testing.assert_close(sparse, reference, rtol=1e-5, atol=1e-5)


def test_people_at_the_corners_of_the_map(config: RunConfig, network: NavigationNetwork) -> None:
    observation = Observation.zeros(9)
    places = [(x, y) for x in (-3.0, 0.0, 3.0) for y in (-3.0, 0.0, 3.0)]
    for i, place in enumerate(places):
        observation.pedestrian_count[i] = 1
        observation.pedestrians[i, 0] = (*place, 0.3, -0.2)
    with torch.no_grad():
        sparse = network(prepare(observation, config))
        reference = network(dense(observation, config))
    torch.testing.assert_close(sparse, reference, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("people", [0.0, 2.0, 10.0])
def test_sparse_gradients_equal_dense_ones(
    config: RunConfig, network: NavigationNetwork, people: float
) -> None:
    observation = random_observation(np.random.default_rng(7), 6, people)
    weights = torch.randn(6, 28, generator=torch.Generator().manual_seed(1))
    gradients = []
    for inputs in (prepare(observation, config), dense(observation, config)):
        network.zero_grad()
        (network(inputs) * weights).sum().backward()
        gradients.append([p.grad.clone() for p in network.parameters() if p.grad is not None])
    for (name, _), sparse, reference in zip(network.named_parameters(), *gradients, strict=True):
        scale = float(reference.abs().max()) + 1e-6
        assert float((sparse - reference).abs().max()) / scale < 1e-4, name


def test_reluctance_makes_the_first_policy_turn_less() -> None:
    config = make_config(turn_reluctance=3.0, map_channels=(4, 4, 4), features=16)
    observation = random_observation(np.random.default_rng(1), 64, 1.0)
    with torch.no_grad():
        logits = build_policy(config)(prepare(observation, config))
    by_turn = torch.softmax(logits, 1).mean(0).reshape(4, 7).sum(0)
    # Turns of -0.9 ... 0.9 rad/s: one e-fold per third of a radian per second, both sides alike.
    expected = np.exp(-3.0 * np.abs(np.array(config.task.angular_velocities)))
    np.testing.assert_allclose(by_turn.numpy(), expected / expected.sum(), rtol=0.1)
