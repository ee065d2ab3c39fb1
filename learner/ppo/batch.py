"""From trajectories to one flat batch of samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from learner.ppo.advantages import generalized_advantages
from learner.ppo.rollout_store import RolloutStore
from lndrl.config import PPOConfig, RunConfig
from lndrl.navigation import Observation, Trajectory
from lndrl.navigation.privileged.floats import GOAL_UNIT, NAMES
from lndrl.navigation.terms import learning_reward

_TRUE_GOAL = [NAMES.index("goal_x"), NAMES.index("goal_y")]


@dataclass(frozen=True)
class Batch:
    """N samples, plus F observations that only bootstrap.

    observation (N) and the arrays (N,) go chunk by chunk, each flattened as t * B + b;
    final_observation (F) likewise in the order of the chunks. In a run with a teacher, teacher
    float16 (N, A) holds what it says that each action costs above its cheapest, and taught
    float32 (N,) is 1 where it was asked, else 0. With a privileged critic, privileged float32
    (N, K) and final_privileged (F, K) are what it sees beside the observations.
    """

    trajectories: tuple[Trajectory, ...]
    observation: Observation
    final_observation: Observation
    action: NDArray[np.int64]
    log_prob: NDArray[np.float32]
    version: NDArray[np.int64]
    teacher: NDArray[np.float16] | None = None
    taught: NDArray[np.float32] | None = None
    privileged: NDArray[np.float32] | None = None
    final_privileged: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self.action)


def assemble(trajectories: Sequence[Trajectory], store: RolloutStore | None = None) -> Batch:
    """Join at least one trajectory into a batch.

    With a ``store`` the batch lives in its memory, until the next one is assembled there.
    """
    return Batch(tuple(trajectories), *(store or RolloutStore()).fill(trajectories))


def batch_advantages(
    batch: Batch,
    value: NDArray[np.float32],
    final_value: NDArray[np.float32],
    ppo: PPOConfig,
    per_metre: float = 0.0,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Advantages (N,) and the value network's targets (N,) from what it says: (N,), finals (F,).

    With ``per_metre`` (see ``way_value``) a state is worth that per metre to the goal, and what the
    network says beside it.
    """
    way = way_to_goal(batch.observation, batch.privileged) * np.float32(per_metre)
    value = value + way
    ahead = way_to_goal(batch.final_observation, batch.final_privileged)
    final_value = final_value + ahead * np.float32(per_metre)
    advantage, target = np.empty_like(value), np.empty_like(value)
    at_cuts = np.zeros_like(value)
    firsts = np.cumsum([0, *(t.action.size for t in batch.trajectories)])
    places = [t.final_index + n for t, n in zip(batch.trajectories, firsts, strict=False)]
    at_cuts[np.concatenate(places)] = final_value
    for steps in {t.steps: None for t in batch.trajectories}:
        # Chunks of one length lie side by side: the loop over time runs once for all of them.
        members = [i for i, t in enumerate(batch.trajectories) if t.steps == steps]
        chunks = [batch.trajectories[i] for i in members]
        rows = [np.s_[firsts[i] : firsts[i + 1]] for i in members]
        terminated = np.concatenate([t.terminated for t in chunks], axis=1).astype(bool)
        truncated = np.concatenate([t.truncated for t in chunks], axis=1).astype(bool)
        if not ppo.bootstrap_truncated:
            terminated, truncated = terminated | truncated, np.zeros_like(truncated)
        results = generalized_advantages(
            learning_reward(np.concatenate([t.reward for t in chunks], axis=1), ppo),
            np.concatenate([value[r].reshape(steps, -1) for r in rows], axis=1),
            terminated,
            truncated,
            np.concatenate([at_cuts[r].reshape(steps, -1) for r in rows], axis=1),
            ppo.gamma,
            ppo.gae_lambda,
        )
        borders = np.cumsum([t.worlds for t in chunks])[:-1]
        for whole, result in zip((advantage, target), results, strict=True):
            for r, columns in zip(rows, np.split(result, borders, axis=1), strict=True):
                whole[r] = columns.reshape(-1)
    return advantage, target - way


def way_value(config: RunConfig) -> float:
    """What values hold per metre to the goal beside the network's; 0 without ``ppo.way_value``.

    The approach reward pays it for every metre, so nearly all that a state far from the goal is
    worth is known without a network, whose error would grow with it.
    """
    return config.task.reward.approach * config.ppo.reward_scale if config.ppo.way_value else 0.0


def way_to_goal(
    observation: Observation, privileged: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    """Metres to the goal (N,): the true ones where the critic may know them, else the believed."""
    goal = observation.goal[:, :2].astype(np.float64)
    if privileged is not None:
        goal = np.expm1(np.abs(privileged[:, _TRUE_GOAL].astype(np.float64))) * GOAL_UNIT
    return np.hypot(goal[:, 0], goal[:, 1]).astype(np.float32)
