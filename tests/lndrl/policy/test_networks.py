"""The paper's networks, and the sparse encoder against the dense one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.config import NetworkConfig, RunConfig
from lndrl.errors import UserError
from lndrl.navigation import Observation, draw_pedestrian_map
from lndrl.navigation.privileged.floats import NAMES
from lndrl.policy import (
    Inputs,
    NavigationNetwork,
    build_policy,
    build_value,
    load_into,
    policy_metadata,
    prepare,
    to_bytes,
)
from lndrl.policy.sparse import map_structure
from lndrl.scenario import Scenario
from tests.lndrl.policy.built_in import built_in, map_encoder_of


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


SMALL: dict[str, object] = {"map_channels": (8, 12, 16), "features": 32, "goal_features": 8}


@pytest.fixture(scope="module", params=["max", "none"])
def config(request: pytest.FixtureRequest) -> RunConfig:
    return make_config(**SMALL, pooling=request.param)


@pytest.fixture(scope="module")
def network(config: RunConfig) -> NavigationNetwork:
    torch.manual_seed(3)
    return with_random_biases(built_in(build_policy(config)))


def crowd(rows: list[list[tuple[float, float]]]) -> Observation:
    """Observations with people at the given places, each with a velocity of its own."""
    observation = Observation.zeros(len(rows))
    for i, places in enumerate(rows):
        observation.pedestrian_count[i] = len(places)
        for k, place in enumerate(places):
            observation.pedestrians[i, k] = (*place, 0.3 - 0.1 * k, 0.05 * k - 0.2)
    return observation


def adversarial() -> Observation:
    """Nobody; corners and borders; one on top of the other; the view full of people."""
    side = (-3.0, 0.0, 3.0)
    border = [(x, y) for x in side for y in side]
    grid = [(x, y) for x in (-2.5, -1.5, -0.5, 0.5, 1.5, 2.5) for y in (-2.25, -0.75, 0.75, 2.25)]
    return crowd(
        [
            [],
            *[[place] for place in border],
            border,
            [(1.0, 1.0)] * 5,
            [(1.0, 1.0), (1.1, 0.9), (1.2, 1.05)],
            [(2.99, -2.99), (-2.99, 2.99)],
            grid,
            [],
        ]
    )


def test_papers_parameter_counts() -> None:
    config = make_config(initialization="default")
    assert sum(p.numel() for p in build_policy(config).parameters()) == 7_615_804
    assert sum(p.numel() for p in build_value(config).parameters()) == 7_601_953


def test_without_pooling_the_map_keeps_its_size() -> None:
    config = make_config(pooling="none", map_channels=(2, 2, 2), features=8)
    network = build_policy(config)
    assert map_encoder_of(network).linear.weight.numel() == 8 * 2 * 48 * 48
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


def test_sparse_equals_dense_on_adversarial_maps(
    config: RunConfig, network: NavigationNetwork
) -> None:
    observation = adversarial()
    with torch.no_grad():
        sparse = network(prepare(observation, config))
        reference = network(dense(observation, config))
    torch.testing.assert_close(sparse, reference, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("cells", [24, 32, 56])
def test_sparse_equals_dense_on_maps_of_other_sizes(cells: int) -> None:
    config = make_config(**SMALL)
    task = config.task.model_copy(update={"map_cells": cells})
    config = config.model_copy(update={"task": task})
    network = with_random_biases(built_in(build_policy(config)))
    with torch.no_grad():
        sparse = network(prepare(adversarial(), config))
        reference = network(dense(adversarial(), config))
    torch.testing.assert_close(sparse, reference, rtol=1e-5, atol=1e-5)


def test_a_map_without_an_interior_is_evaluated_densely() -> None:
    config = make_config(**SMALL)
    task = config.task.model_copy(update={"map_cells": 16})
    config = config.model_copy(update={"task": task})
    assert isinstance(prepare(adversarial(), config).people, torch.Tensor)
    with pytest.raises(ValueError, match="16 cells"):
        map_structure(adversarial(), task)


@pytest.mark.parametrize("people", [0.0, 2.0, 10.0, None])
def test_sparse_gradients_equal_dense_ones(
    config: RunConfig, network: NavigationNetwork, people: float | None
) -> None:
    rng = np.random.default_rng(7)
    observation = adversarial() if people is None else random_observation(rng, 6, people)
    generator = torch.Generator().manual_seed(1)
    weights = torch.randn(len(observation), 28, generator=generator)
    gradients = []
    for inputs in (prepare(observation, config), dense(observation, config)):
        network.zero_grad()
        (network(inputs) * weights).sum().backward()
        gradients.append([p.grad.clone() for p in network.parameters() if p.grad is not None])
    for (name, _), sparse, reference in zip(network.named_parameters(), *gradients, strict=True):
        scale = float(reference.abs().max()) + 1e-6
        assert float((sparse - reference).abs().max()) / scale < 1e-4, name


def test_frozen_weights_change_nothing(config: RunConfig) -> None:
    network = with_random_biases(built_in(build_policy(config)))
    inputs = prepare(adversarial(), config)
    with torch.no_grad():
        before = network(inputs)
        map_encoder_of(network).freeze()
        torch.testing.assert_close(network(inputs), before, rtol=1e-6, atol=1e-6)


def test_reluctance_makes_the_first_policy_turn_less() -> None:
    config = make_config(turn_reluctance=3.0, map_channels=(4, 4, 4), features=16)
    observation = random_observation(np.random.default_rng(1), 64, 1.0)
    with torch.no_grad():
        logits = build_policy(config)(prepare(observation, config))
    by_turn = torch.softmax(logits, 1).mean(0).reshape(4, 7).sum(0)
    # Turns of -0.9 ... 0.9 rad/s: one e-fold per third of a radian per second, both sides alike.
    expected = np.exp(-3.0 * np.abs(np.array(config.task.angular_velocities)))
    np.testing.assert_allclose(by_turn.numpy(), expected / expected.sum(), rtol=0.1)


def test_variances_are_scaled_where_the_networks_read_them() -> None:
    torch.manual_seed(0)
    plain = build_policy(make_config(**SMALL))
    scaled = build_policy(make_config(**SMALL, variance_scale=10.0))
    scaled.load_state_dict(plain.state_dict())
    observation = random_observation(np.random.default_rng(2), 4, 1.0)
    larger = observation.copy()
    larger.goal[:, 3:] *= 10.0
    with torch.no_grad():
        expected = plain(prepare(larger, make_config(**SMALL)))
        torch.testing.assert_close(scaled(prepare(observation, make_config(**SMALL))), expected)
        assert not torch.allclose(plain(prepare(observation, make_config(**SMALL))), expected)


@pytest.mark.parametrize("evaluate", ["sparse", "dense"])
def test_layer_norm_normalizes_the_trunks_units_in_both_networks(evaluate: str) -> None:
    config = make_config(**SMALL, layer_norm=True)
    rng = np.random.default_rng(8)
    observation = random_observation(rng, 7, 3.0)
    inputs = prepare(observation, config) if evaluate == "sparse" else dense(observation, config)
    for build in (build_policy, build_value):
        network = with_random_biases(built_in(build(config)))
        seen: list[torch.Tensor] = []
        network.trunk.register_forward_hook(lambda *call, kept=seen: kept.append(call[-1]))
        with torch.no_grad():
            answer = network(inputs)
        units = seen[0].double()
        spread = (units.var(1, correction=0, keepdim=True) + 1e-5).sqrt()
        normalized = (units - units.mean(1, keepdim=True)) / spread
        assert network.norm is not None
        scaled = normalized * network.norm.weight.double() + network.norm.bias.double()
        expected = scaled.relu() @ network.head.weight.double().T + network.head.bias.double()
        torch.testing.assert_close(answer.double(), expected, atol=1e-5, rtol=1e-5)


def test_layer_norm_trains_sparsely_as_densely() -> None:
    config = make_config(**SMALL, layer_norm=True)
    network = with_random_biases(built_in(build_policy(config)))
    observation = random_observation(np.random.default_rng(9), 6, 2.0)
    gradients = []
    for inputs in (prepare(observation, config), dense(observation, config)):
        network.zero_grad()
        network(inputs).square().sum().backward()
        gradients.append([p.grad.clone() for p in network.parameters() if p.grad is not None])
    assert len(gradients[0]) == len(list(network.parameters()))
    for one, other in zip(*gradients, strict=True):
        torch.testing.assert_close(one, other, atol=1e-3, rtol=1e-3)
    # As actors on bfloat16 hardware evaluate it, too.
    with torch.no_grad():
        fine = torch.log_softmax(network(prepare(observation, config)), 1)
        network.freeze()
        coarse = network.coarse()
        coarse.freeze()
        with torch.autocast("cpu", torch.bfloat16):
            about = torch.log_softmax(coarse(prepare(observation, config)).float(), 1)
    torch.testing.assert_close(about, fine, atol=0.15, rtol=0.1)


def test_without_layer_norm_weights_are_those_of_before(config: RunConfig) -> None:
    names = set(build_policy(config).state_dict())
    assert not any("norm" in name for name in names)
    normed = config.model_copy(
        update={"network": config.network.model_copy(update={"layer_norm": True})}
    )
    policy = build_policy(normed)
    assert set(policy.state_dict()) - names == {"norm.weight", "norm.bias"}
    blob = to_bytes(build_policy(config), policy_metadata(config, 1, 1))
    with pytest.raises(UserError, match="no layer norm; this configuration has a layer norm"):
        load_into(policy, blob, "old", normed)


def test_a_network_of_ones_own_normalizes_for_itself() -> None:
    with pytest.raises(ValueError, match="layer_norm is of the built-in network's trunk"):
        make_config(policy="my_module:Network", layer_norm=True)


def test_the_value_network_alone_sees_privileged_floats() -> None:
    plain = make_config()
    config = plain.model_copy(
        update={"learner": plain.learner.model_copy(update={"privileged_critic": True})}
    )
    policy, value = build_policy(config), build_value(config)
    assert list(policy.state_dict()) == list(build_policy(plain).state_dict())
    new = set(value.state_dict()) - set(build_value(plain).state_dict())
    assert new == {"privileged_encoder.weight", "privileged_encoder.bias"}
    rng = np.random.default_rng(0)
    observation = random_observation(rng, 3, 1.0)
    floats = rng.normal(size=(3, len(NAMES))).astype(np.float32)
    one, other = (prepare(observation, config, each) for each in (floats, floats + 1.0))
    with torch.no_grad():
        assert torch.equal(policy(one), policy(other))
        assert not torch.equal(value(one), value(other))
        assert torch.equal(value(one), value(prepare(observation, config, floats.copy())))
    with pytest.raises(ValueError, match="needs privileged floats"):
        value(prepare(observation, config))
    value(one).sum().backward()
    assert isinstance(value, NavigationNetwork) and value.privileged_encoder is not None
    assert value.privileged_encoder.weight.grad is not None
