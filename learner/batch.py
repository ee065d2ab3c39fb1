"""From trajectories to one flat batch of samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from learner.advantages import generalized_advantages
from lndrl.config import PPOConfig
from lndrl.navigation import Observation, Trajectory


@dataclass(frozen=True)
class Batch:
    """N samples, plus F observations that only bootstrap.

    observation (N) and the arrays (N,) go chunk by chunk, each flattened as t * B + b;
    final_observation (F) likewise in the order of the chunks.
    """

    trajectories: tuple[Trajectory, ...]
    observation: Observation
    final_observation: Observation
    action: NDArray[np.int64]
    log_prob: NDArray[np.float32]
    version: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.action)


def assemble(trajectories: Sequence[Trajectory]) -> Batch:
    """Join at least one trajectory into a batch."""
    return Batch(
        trajectories=tuple(trajectories),
        observation=Observation.concatenate([t.observation.flatten() for t in trajectories]),
        final_observation=Observation.concatenate([t.final_observation for t in trajectories]),
        action=np.concatenate([t.action.reshape(-1) for t in trajectories]).astype(np.int64),
        log_prob=np.concatenate([t.log_prob.reshape(-1) for t in trajectories]),
        version=np.concatenate([t.version.reshape(-1) for t in trajectories]).astype(np.int64),
    )


def batch_advantages(
    batch: Batch,
    value: NDArray[np.float32],
    final_value: NDArray[np.float32],
    ppo: PPOConfig,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Advantages and value targets (N,) from values (N,) and final values (F,)."""
    advantages, targets = [], []
    sample, final = 0, 0
    for trajectory in batch.trajectories:
        shape = trajectory.reward.shape
        count, cuts = trajectory.reward.size, len(trajectory.final_index)
        at_cuts = np.zeros(count, np.float32)
        at_cuts[trajectory.final_index] = final_value[final : final + cuts]
        terminated = trajectory.terminated.astype(bool)
        truncated = trajectory.truncated.astype(bool)
        if not ppo.bootstrap_truncated:
            terminated, truncated = terminated | truncated, np.zeros_like(truncated)
        advantage, target = generalized_advantages(
            learning_reward(trajectory.reward, ppo),
            value[sample : sample + count].reshape(shape),
            terminated,
            truncated,
            at_cuts.reshape(shape),
            ppo.gamma,
            ppo.gae_lambda,
        )
        advantages.append(advantage.reshape(-1))
        targets.append(target.reshape(-1))
        sample, final = sample + count, final + cuts
    return np.concatenate(advantages), np.concatenate(targets)


def learning_reward(reward: NDArray[np.float32], ppo: PPOConfig) -> NDArray[np.float32]:
    """Rewards as the learner uses them: scaled, then clipped where a limit is set."""
    scaled = reward * np.float32(ppo.reward_scale)
    return scaled if ppo.reward_limit is None else scaled.clip(-ppo.reward_limit, ppo.reward_limit)
