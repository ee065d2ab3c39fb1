"""Averaged weights: what the last updates agree on, beside the weights that are trained."""

from __future__ import annotations

import copy

import torch

from lndrl.policy import Network


class Average:
    """Exponential moving average of a network's weights, one value per update.

    The newest weights count ``1 - decay``; while fewer updates than that have come, all count
    alike, so that the first weights, which know nothing, are soon forgotten. What a class of the
    user's own keeps beside parameters (buffers) is copied, not averaged.

    Attributes:
        network: holds the averaged weights, where ``trained`` is; nothing trains it.
        updates: how many have been averaged; part of a checkpoint.
    """

    def __init__(self, trained: Network, decay: float) -> None:
        self.network: Network = copy.deepcopy(trained).requires_grad_(False)
        self.updates = 0
        self._decay = decay

    @torch.no_grad()
    def add(self, trained: Network) -> None:
        """Take in the weights of ``trained`` after an update; its place is that of the average."""
        self.updates += 1
        share = max(1.0 - self._decay, 1.0 / self.updates)
        torch._foreach_lerp_(  # all tensors in a few launches
            list(self.network.parameters()), list(trained.parameters()), share
        )
        for target, source in zip(self.network.buffers(), trained.buffers(), strict=True):
            target.copy_(source)
