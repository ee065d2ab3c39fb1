"""The last good state of networks and optimizers, in memory that is taken once."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from learner.ppo.trainee import Trainee


class Safeguard:
    """Copies of weights and Adam's moments of ``trainees``, restored in place.

    In place, because recorded CUDA graphs work on the memory that they were recorded with. Weights
    come back bit for bit, moments rounded to the eight bits of bfloat16: two thirds of what is kept
    would be theirs, in case of an update that hardly ever comes, and they are averages of noise.
    """

    def __init__(self, trainees: Sequence[Trainee]) -> None:
        self._trainees = trainees
        self._copies: dict[Tensor, Tensor] = {}

    @torch.no_grad()
    def keep(self) -> None:
        """Remember the state of this moment."""
        for tensor in self._tensors():
            copy = self._copies.get(tensor)
            if copy is None:
                self._copies[tensor] = tensor.detach().to(_kind(tensor), copy=True)
            else:
                copy.copy_(tensor, non_blocking=True)

    @torch.no_grad()
    def restore(self) -> None:
        """Go back to what was kept last; nothing else may work on the networks meanwhile."""
        for tensor in self._tensors():
            copy = self._copies.get(tensor)
            if copy is None:
                tensor.zero_()  # Adam's beginning: it had no moments yet
            else:
                tensor.copy_(copy)

    def is_finite(self) -> bool:
        """Whether every weight and moment is a number. Waits for the device."""
        # What is not finite shows in the sum, in one quick pass; what overflows it has diverged.
        sums = [tensor.detach().sum() for tensor in self._tensors() if tensor.ndim]
        return bool(torch.isfinite(torch.stack(sums)).all())

    def _tensors(self) -> list[Tensor]:
        tensors: list[Tensor] = []
        for trainee in self._trainees:
            tensors += trainee.parameters
            for parameter in trainee.parameters:
                tensors += trainee.optimizer.state.get(parameter, {}).values()
        return tensors


def _kind(tensor: Tensor) -> torch.dtype:
    """The type of the copy of ``tensor``; steps are counted, which bfloat16 cannot."""
    is_moment = tensor.ndim and not tensor.requires_grad
    return torch.bfloat16 if is_moment else tensor.dtype
