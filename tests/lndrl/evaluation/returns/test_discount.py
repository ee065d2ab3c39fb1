"""Discounting against a slow twin, and what a learner's limit leaves of each part."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.config import PPOConfig
from lndrl.evaluation.returns import discounted_sums, learning_parts
from lndrl.navigation.terms import learning_reward

DISCOUNTS = (0.5, 0.95, 1.0)


def ppo(scale: float, limit: float | None) -> PPOConfig:
    return PPOConfig.model_validate({"reward_scale": scale, "reward_limit": limit})


def test_sums_are_those_of_a_slow_twin() -> None:
    rewards = np.random.default_rng(1).normal(size=(37, 6))
    sums = discounted_sums(rewards, DISCOUNTS)
    for d, discount in enumerate(DISCOUNTS):
        for part in range(6):
            worth, total = 1.0, 0.0
            for reward in rewards[:, part]:
                total += worth * reward
                worth *= discount
            assert sums[d, part] == pytest.approx(total, rel=1e-12)


def test_the_first_step_counts_in_full() -> None:
    np.testing.assert_allclose(discounted_sums(np.array([[3.0], [2.0]]), (0.5,)), [[4.0]])


def test_parts_add_up_to_what_the_learner_sees() -> None:
    parts = np.random.default_rng(2).normal(scale=400.0, size=(200, 6))
    for settings in (ppo(0.01, 5.0), ppo(0.01, None)):
        seen, limited = learning_parts(parts, settings)
        expected = learning_reward(parts.sum(axis=1).astype(np.float32), settings)
        np.testing.assert_allclose(seen.sum(axis=1), expected, rtol=1e-6, atol=1e-9)
        beyond = np.abs(0.01 * parts.sum(axis=1)) > 5.0
        assert 20 < beyond.sum() < 180, "both kinds are tested"
        np.testing.assert_array_equal(limited, beyond & (settings.reward_limit is not None))
        np.testing.assert_allclose(seen[~limited], 0.01 * parts[~limited], rtol=1e-6)


def test_a_limit_leaves_each_part_its_share() -> None:
    seen, limited = learning_parts(np.array([[-4500.0, -500.0], [10.0, -10.0]]), ppo(0.01, 5.0))
    np.testing.assert_allclose(seen, [[-4.5, -0.5], [0.1, -0.1]], rtol=1e-6)
    assert limited.tolist() == [True, False]
