"""What changes over a run, as pure functions of its progress in [0, 1]: the same after a resume."""

from __future__ import annotations

from lndrl.config import PPOConfig


def entropy_weight(ppo: PPOConfig, progress: float) -> float:
    """Weight of the policy's entropy: a line from ``entropy`` to ``entropy_final``."""
    if ppo.entropy_final is None:
        return ppo.entropy
    return ppo.entropy + progress * (ppo.entropy_final - ppo.entropy)
