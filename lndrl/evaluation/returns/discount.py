"""What a learner sees of an episode's rewards, and what they come to at a discount."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lndrl.config import PPOConfig
from lndrl.navigation.terms import learning_reward

Floats = NDArray[np.float64]


def learning_parts(parts: Floats, ppo: PPOConfig) -> tuple[Floats, NDArray[np.bool_]]:
    """The rewards' summands ``parts`` (T, P) of T steps as the learner sees them (T, P), and
    whether ``ppo.reward_limit`` cut the step (T,).

    The limit cuts the sum of a step. Of what it leaves every part has the share that it had, so
    the parts still add up to what is learned from.
    """
    paid = parts.sum(axis=1)
    seen = learning_reward(paid.astype(np.float32), ppo).astype(np.float64)
    # A sum of 0 is none that a limit cuts, but its parts have values of their own.
    factor = np.divide(seen, paid, out=np.full(len(paid), ppo.reward_scale), where=paid != 0.0)
    limit = np.inf if ppo.reward_limit is None else np.float32(ppo.reward_limit)
    return parts * factor[:, None], np.abs(seen) >= limit


def discounted_sums(rewards: Floats, discounts: Sequence[float]) -> Floats:
    """Sums over time of ``rewards`` (T, P), each step worth ``discount`` times the one before it;
    (D, P), a row per discount. The first step counts in full.
    """
    powers = np.asarray(discounts, dtype=np.float64)[:, None] ** np.arange(len(rewards))
    sums: Floats = powers @ rewards
    return sums
