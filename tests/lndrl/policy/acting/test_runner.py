"""Acting and weights in and out."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from lndrl.errors import UserError
from lndrl.policy import PolicyRunner, build_policy, initial_weights, to_bytes
from tests.lndrl.policy.built_in import built_in
from tests.lndrl.policy.test_networks import make_config, random_observation

CONFIG = make_config(map_channels=(4, 4, 4), features=16, goal_features=4)


def runner(bfloat16: bool = False, **changed: Tensor) -> PolicyRunner:
    """With the initial weights, but for the head's parameters that are given."""
    torch.manual_seed(CONFIG.seed)
    network = built_in(build_policy(CONFIG))
    for name, values in changed.items():
        getattr(network.head, name).data[:] = values
    made = PolicyRunner(CONFIG, bfloat16=bfloat16)
    made.load(to_bytes(network))
    return made


def test_sampled_actions_follow_the_probabilities() -> None:
    # Far from uniform, or a wrong sampler would pass.
    bias = torch.zeros(28)
    bias[3], bias[20] = 3.0, 2.0
    policy = runner(bias=bias)
    observation = random_observation(np.random.default_rng(0), 1, 1.0)
    probabilities = np.exp(policy.log_probabilities(observation))[0]
    repeated = observation.take(np.zeros(4000, int))
    action, log_prob = policy.act(repeated, np.random.default_rng(1))
    counts = np.bincount(action, minlength=28) / len(action)
    # Four standard deviations of a share near a half: 4 * sqrt(0.25 / 4000).
    assert np.abs(counts - probabilities).max() < 0.032
    np.testing.assert_allclose(log_prob, np.log(probabilities[action]), rtol=1e-4, atol=1e-5)


def test_greedy_takes_the_likeliest_and_seeds_repeat() -> None:
    policy = runner()
    observation = random_observation(np.random.default_rng(0), 32, 1.0)
    greedy, log_prob = policy.act(observation, np.random.default_rng(0), greedy=True)
    table = policy.log_probabilities(observation)
    np.testing.assert_array_equal(greedy, table.argmax(1))
    np.testing.assert_allclose(log_prob, table.max(1), rtol=1e-5)
    first = policy.act(observation, np.random.default_rng(5))[0]
    np.testing.assert_array_equal(first, policy.act(observation, np.random.default_rng(5))[0])


def test_bfloat16_is_the_same_policy_within_its_digits() -> None:
    differences = []
    for seed in range(8):
        weight = torch.randn(28, 16, generator=torch.Generator().manual_seed(seed))
        exact, coarse = (runner(bfloat16, weight=weight) for bfloat16 in (False, True))
        observation = random_observation(np.random.default_rng(seed), 32, 2.0)
        answers = (each.log_probabilities(observation) for each in (exact, coarse))
        differences.append(np.abs(next(answers) - next(answers)))
    # Products of eight bits each: 2^-8 of logits that differ by about ten is 0.04.
    assert 0.0 < np.mean(differences) < 0.01 and np.quantile(differences, 0.999) < 0.1


def test_weights_of_another_network_are_refused_by_name() -> None:
    other = make_config(map_channels=(4, 4, 4), features=24, goal_features=4)
    with pytest.raises(UserError, match=r"linear.*another network"):
        PolicyRunner(CONFIG).load(initial_weights(other))
    with pytest.raises(UserError, match="not a safetensors file"):
        PolicyRunner(CONFIG).load(b"nonsense")
