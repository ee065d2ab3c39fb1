"""What changes over a run, as pure functions of its progress in [0, 1]: the same after a resume."""

from __future__ import annotations

import math

from lndrl.config import PPOConfig


def batch_size(ppo: PPOConfig, progress: float) -> int:
    """Samples of the next update: ``batch_size``, doubled up to ``batch_size_final``.

    By doublings, not by a little each time: memory and recorded CUDA graphs fit one size of a
    batch, and there are then few. Each size holds for the same number of steps.
    """
    first, last = ppo.batch_size, ppo.batch_size_final
    if last is None or last <= first:
        return first
    doublings = math.ceil(math.log2(last / first) - 1e-9)
    return min(last, first << min(doublings, int(progress * (doublings + 1))))


def entropy_weight(ppo: PPOConfig, progress: float) -> float:
    """Weight of the policy's entropy: a line from ``entropy`` to ``entropy_final``."""
    if ppo.entropy_final is None:
        return ppo.entropy
    return ppo.entropy + progress * (ppo.entropy_final - ppo.entropy)
