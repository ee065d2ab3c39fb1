"""GAE against a slow twin and by hand."""

from __future__ import annotations

import numpy as np
import pytest

from learner.ppo.advantages import generalized_advantages


def slow_twin(reward, value, terminated, truncated, at_cuts, gamma, gae_lambda):
    """The sum of discounted one-step errors, written out."""
    steps, worlds = reward.shape
    advantage = np.zeros((steps, worlds))
    for b in range(worlds):
        for t in range(steps):
            total, weight = 0.0, 1.0
            for k in range(t, steps):
                if terminated[k, b]:
                    following = 0.0
                elif truncated[k, b] or k == steps - 1:
                    following = at_cuts[k, b]
                else:
                    following = value[k + 1, b]
                total += weight * (reward[k, b] + gamma * following - value[k, b])
                if terminated[k, b] or truncated[k, b]:
                    break
                weight *= gamma * gae_lambda
            advantage[t, b] = total
    return advantage


@pytest.mark.parametrize("seed", range(5))
def test_equals_the_slow_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (23, 4)
    reward, value, at_cuts = rng.normal(size=(3, *shape)).astype(np.float32)
    ends = rng.uniform(size=shape)
    terminated, truncated = ends < 0.1, (ends > 0.1) & (ends < 0.2)
    advantage, target = generalized_advantages(
        reward, value, terminated, truncated, at_cuts, 0.97, 0.9
    )
    expected = slow_twin(reward, value, terminated, truncated, at_cuts, 0.97, 0.9)
    np.testing.assert_allclose(advantage, expected, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(target, advantage + value, rtol=1e-6)


def test_termination_has_no_future_and_truncation_has() -> None:
    zeros = np.zeros((1, 1), np.float32)
    future = np.full((1, 1), 10.0, np.float32)
    yes, no = np.ones((1, 1), bool), np.zeros((1, 1), bool)
    ended, _ = generalized_advantages(zeros, zeros, yes, no, future, 0.9, 1.0)
    cut, _ = generalized_advantages(zeros, zeros, no, yes, future, 0.9, 1.0)
    assert ended[0, 0] == 0.0
    assert cut[0, 0] == pytest.approx(9.0)
