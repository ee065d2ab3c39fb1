"""Adam by torch's fused kernels, without the class that torch wraps around them.

The first ``torch.optim.Optimizer`` of a process imports torch's compiler, which nothing here uses:
that is a good third of all the time until a learner listens, and 70 MB. The state has the names and
shapes of ``torch.optim.Adam``.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.optim.adam import adam

_BETAS = (0.9, 0.999)


class Adam:
    """Adam (Kingma and Ba, 2015) without weight decay.

    Args:
        parameters: float tensors with gradients, all on one device; trained in place.
        rate: learning rate. On devices other than the CPU it becomes a tensor there, so that CUDA
            graphs see it change.
        epsilon: added to the root of the second moment.

    Attributes:
        state: by parameter, from ``begin`` or its first step on: ``step`` (scalar float32),
            ``exp_avg`` and ``exp_avg_sq`` (each like the parameter), all on its device.
    """

    def __init__(self, parameters: Sequence[Tensor], rate: float, epsilon: float) -> None:
        self.parameters = list(parameters)
        self.state: dict[Tensor, dict[str, Tensor]] = {}
        self._epsilon = epsilon
        device = self.parameters[0].device
        on_cpu = device.type == "cpu"
        self._rate: float | Tensor = rate if on_cpu else torch.tensor(rate, device=device)

    @property
    def rate(self) -> float:
        """Learning rate; waits for the device."""
        return float(self._rate)

    @rate.setter
    def rate(self, rate: float) -> None:
        if isinstance(self._rate, Tensor):
            self._rate.fill_(rate)
        else:
            self._rate = rate

    def begin(self) -> None:
        """Make the moments that are missing, in the calling thread's memory."""
        for parameter in self.parameters:
            if parameter not in self.state:
                self._begin(parameter)

    def forget_gradients(self) -> None:
        """Free the gradients; the next backward pass writes them instead of adding to them."""
        for parameter in self.parameters:
            parameter.grad = None

    @torch.no_grad()
    def step(self, divisor: Tensor) -> None:
        """One step with the gradients there are, ``divisor`` (scalar on the device) taken out.

        The gradients are divided in place on the way: clipping needs no pass of its own.
        """
        moving = [parameter for parameter in self.parameters if parameter.grad is not None]
        states = [self.state.get(parameter) or self._begin(parameter) for parameter in moving]
        adam(
            moving,
            [parameter.grad for parameter in moving if parameter.grad is not None],
            [state["exp_avg"] for state in states],
            [state["exp_avg_sq"] for state in states],
            [],
            [state["step"] for state in states],
            fused=True,
            capturable=isinstance(self._rate, Tensor),
            grad_scale=divisor,
            amsgrad=False,
            beta1=_BETAS[0],
            beta2=_BETAS[1],
            lr=self._rate,
            weight_decay=0.0,
            eps=self._epsilon,
            maximize=False,
        )

    def _begin(self, parameter: Tensor) -> dict[str, Tensor]:
        """Its moments before the first step."""
        state = {
            "step": torch.zeros((), device=parameter.device),
            "exp_avg": torch.zeros_like(parameter),
            "exp_avg_sq": torch.zeros_like(parameter),
        }
        self.state[parameter] = state
        return state
