"""The PPO update on a problem whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from helpers_learner import random_trajectory, small_config

from learner.batch import assemble, batch_advantages, learning_reward
from learner.update import PPO, DivergedError
from lndrl.policy import prepare


@pytest.fixture
def ppo():
    made = []

    def make(**settings):
        made.append(PPO(small_config(ppo=settings)))
        return made[-1]

    yield make
    for each in made:
        each.close()


def bandit_batch(ppo: PPO, good: int):
    """Every step ends the episode; only action ``good`` pays."""
    trajectory = random_trajectory(ppo.config, seed=1, steps=32, worlds=4)
    none = np.zeros_like(trajectory.truncated)
    trajectory = replace(
        trajectory,
        terminated=np.ones_like(none),
        truncated=none,
        action=np.random.default_rng(2).integers(0, 28, none.shape).astype(np.uint8),
        final_index=np.zeros(0, np.int32),
        final_observation=trajectory.final_observation.take(slice(0, 0)),
    )
    return assemble([replace(trajectory, reward=np.float32(100.0) * (trajectory.action == good))])


@pytest.mark.parametrize("joint", [False, True])
def test_the_action_that_pays_becomes_likelier(ppo, joint: bool) -> None:
    trainer = ppo(actor_learning_rate=3e-3, epochs=6, joint_gradient_norm=joint)
    batch = bandit_batch(trainer, good=5)

    def probability() -> float:
        with torch.no_grad():
            logits = trainer.policy(prepare(batch.observation, trainer.config))
        return float(torch.softmax(logits, 1)[:, 5].mean())

    before = probability()
    figures = trainer.update(batch, progress=0.0)
    assert probability() > 1.3 * before
    assert figures["kl"] > 0
    assert figures["learning_rate"] == pytest.approx(3e-3)


def test_the_value_net_learns_its_targets(ppo) -> None:
    trainer = ppo(critic_learning_rate=3e-3, epochs=8)
    batch = bandit_batch(trainer, good=5)
    losses = [trainer.update(batch, 0.0)["value_loss"] for _ in range(4)]
    assert losses[-1] < 0.8 * losses[0]


def test_same_seed_same_bits(ppo) -> None:
    results = []
    for _ in range(2):
        trainer = ppo()
        batch = assemble([random_trajectory(trainer.config, seed) for seed in (3, 4)])
        figures = trainer.update(batch, 0.25)
        results.append((figures, [p.detach().clone() for p in trainer.policy.parameters()]))
    assert results[0][0] == results[1][0]
    assert all(torch.equal(a, b) for a, b in zip(results[0][1], results[1][1], strict=True))


def test_linear_schedule_ends_at_zero_and_target_kl_stops(ppo) -> None:
    trainer = ppo(target_kl=1e-9, epochs=5, actor_learning_rate=1e-2)
    batch = assemble([random_trajectory(trainer.config, 5)])
    assert trainer.update(batch, 1.0)["learning_rate"] == 0.0
    steps = trainer.policy_optimizer.state[next(trainer.policy.parameters())]["step"]
    before = int(steps)
    trainer.update(batch, 0.0)
    # 16 samples are one minibatch: the first epoch moves the policy, the second sees it and stops.
    assert int(steps) - before == 2


def test_full_batch_step_equals_its_parts(ppo) -> None:
    """A full-batch step in pieces of 512 rows has the gradient of the whole."""
    trainer = ppo(minibatch_size=None, epochs=1)
    batch = assemble([random_trajectory(trainer.config, s, steps=40, worlds=16) for s in (1, 2)])
    target = np.random.default_rng(0).normal(size=len(batch)).astype(np.float32)
    trainer._value_backward(batch, target, np.arange(len(batch)))
    pieces = [p.grad.clone() for p in trainer.value.parameters() if p.grad is not None]
    trainer.value_optimizer.zero_grad()
    value = trainer.value(prepare(batch.observation, trainer.config)).squeeze(1)
    (0.5 * (value - torch.from_numpy(target)).square().mean()).backward()
    for piece, parameter in zip(pieces, trainer.value.parameters(), strict=True):
        torch.testing.assert_close(piece, parameter.grad, rtol=1e-3, atol=1e-5)


def test_non_finite_input_is_said(ppo) -> None:
    trainer = ppo()
    trajectory = random_trajectory(trainer.config, 6)
    trajectory.reward[0, 0] = np.nan
    with pytest.raises(DivergedError, match="loss"):
        trainer.update(assemble([trajectory]), 0.0)


def test_rewards_are_scaled_then_clipped() -> None:
    ppo = small_config(ppo={"reward_scale": 0.01, "reward_limit": 5.0}).ppo
    reward = np.array([100.0, -9000.0, 700.0], np.float32)
    np.testing.assert_allclose(learning_reward(reward, ppo), [1.0, -5.0, 5.0])
    plain = ppo.model_copy(update={"reward_limit": None})
    np.testing.assert_allclose(learning_reward(reward, plain), [1.0, -90.0, 7.0])


def test_batch_advantages_go_chunk_by_chunk() -> None:
    config = small_config()
    chunks = [random_trajectory(config, seed) for seed in (7, 8)]
    batch = assemble(chunks)
    rng = np.random.default_rng(0)
    value = rng.normal(size=len(batch)).astype(np.float32)
    final = rng.normal(size=len(batch.final_observation)).astype(np.float32)
    advantage, target = batch_advantages(batch, value, final, config.ppo)
    half, cut = len(batch) // 2, len(chunks[0].final_index)
    alone, _ = batch_advantages(assemble(chunks[1:]), value[half:], final[cut:], config.ppo)
    np.testing.assert_array_equal(advantage[half:], alone)
    np.testing.assert_allclose(target, advantage + value, rtol=1e-5)


def test_group_setting_treats_a_timeout_as_an_end() -> None:
    config = small_config(ppo={"bootstrap_truncated": False})
    trajectory = random_trajectory(config, 9)
    batch = assemble([trajectory])
    value = np.zeros(len(batch), np.float32)
    final = np.full(len(batch.final_observation), 50.0, np.float32)
    advantage, _ = batch_advantages(batch, value, final, config.ppo)
    timeouts = trajectory.truncated.astype(bool).reshape(-1)
    assert timeouts.any()
    np.testing.assert_allclose(
        advantage[timeouts], 0.01 * trajectory.reward.reshape(-1)[timeouts], rtol=1e-5
    )
