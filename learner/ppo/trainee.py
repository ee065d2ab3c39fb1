"""One network in training: its optimizer, its gradient, and its figures."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import AbstractContextManager, nullcontext
from functools import partial

import numpy as np
import torch
from torch import Tensor

from learner.ppo.adam import Adam
from learner.ppo.graphs import GraphedStep
from learner.ppo.samples import MakeInputs
from learner.ppo.team import Channel
from lndrl.config import PPOConfig
from lndrl.policy import Network, record_cuda_graph

Loss = Callable[[Tensor, Tensor], tuple[Tensor, tuple[Tensor, ...]]]
"""(outputs float32 (N, outputs), rows (N,)) -> mean loss with a gradient, figures without."""

_PART = 512  # rows per backward pass: a full-batch step needs no more memory than that


class DivergedError(RuntimeError):
    """A loss or gradient was not finite; the networks may be spoilt."""


class Trainee:
    """A network, Adam, and sums of figures that stay on the device until they are asked for.

    Args:
        network: trained in place, on its device.
        rate: learning rate.
        loss, names: the loss and the names of its figures.
        precision: dtype of the products inside the network.
        stream: where a GPU works on it; None: wherever the caller does.
        graphs: record steps as CUDA graphs; needs ``stream``.
        channel: to the other ranks that train the same network; each then evaluates its share of
            the rows, and gradients, outputs and figures are those of all.
    """

    def __init__(
        self,
        network: Network,
        rate: float,
        loss: Loss,
        names: tuple[str, ...],
        ppo: PPOConfig,
        precision: torch.dtype = torch.float32,
        stream: torch.cuda.Stream | None = None,
        graphs: bool = False,
        channel: Channel | None = None,
    ) -> None:
        self.network = network
        self.parameters = list(network.parameters())
        self.device = self.parameters[0].device
        self.optimizer = Adam(self.parameters, rate, ppo.adam_eps)
        self.stream = stream
        self._channel = channel
        self._loss = loss
        self._names = ("loss", *names, "gradient_norm")
        self._limit = ppo.gradient_norm
        self._precision = precision
        self._sums = torch.zeros(len(self._names), dtype=torch.float64, device=self.device)
        self._past: list[tuple[int, dict[str, float]]] = []
        self._inputs: MakeInputs | None = None
        self.graphed: GraphedStep | None = None
        if graphs and stream is not None:
            self.graphed = GraphedStep(self._whole_step, partial(record_cuda_graph, stream))

    def memory_moved(self) -> None:
        """What steps read from has other addresses from now on."""
        if self.graphed is not None:
            self.graphed.forget()

    # -- steps -------------------------------------------------------------------------------

    def begin(self, inputs: MakeInputs) -> None:
        """Start anew with figures; steps to come read from ``inputs``.

        Call it in the thread that lives longest: it makes the moments, which stay.
        """
        self.optimizer.begin()
        if self._channel is not None:
            self._channel.begin(self.parameters)
        self._inputs = inputs
        self._past.clear()
        self._sums.zero_()

    def step(self, key: Hashable, rows: Tensor) -> None:
        """One step of Adam on ``rows`` (N,), which ``key`` names to those who share inputs."""
        if self.graphed is not None:
            self.graphed(rows)
        else:
            self._whole_step(rows, key)

    def gradient(self, key: Hashable, rows: Tensor) -> None:
        """Replace the gradient by that of the mean loss over ``rows``."""
        assert self._inputs is not None
        # Gradients are written, not added to zeros: two passes over 30 MB less.
        self.optimizer.forget_gradients()
        mine = rows if self._channel is None else self._channel.share(rows)
        parts = mine.tensor_split(-(-len(mine) // _PART)) if len(mine) else ()
        for number, part in enumerate(parts):
            with self._autocast():
                outputs = self.network(self._inputs((key, number), part))
            loss, figures = self._loss(outputs, part)
            share = len(part) / len(rows)
            (loss * share).backward()
            self._sums[:-1].add_(torch.stack((loss.detach(), *figures)), alpha=share)
        if self._channel is not None:
            self._channel.sum_gradients(self.parameters)

    def norm(self) -> Tensor:
        """Euclidean norm of the gradient, a scalar on the device."""
        gradients = [p.grad for p in self.parameters if p.grad is not None]
        return torch.nn.utils.get_total_norm(gradients)

    def apply(self, norm: Tensor) -> None:
        """One step of Adam with the gradient, scaled down where ``norm`` exceeds its limit."""
        self.optimizer.step((norm / self._limit).clamp(min=1.0))
        self._sums[-1].add_(norm)

    def end(self) -> None:
        """Free the gradient: no step follows for now.

        Best called in the thread that made it: its memory is then nearly empty between updates,
        and can go back to the system.
        """
        self.optimizer.forget_gradients()

    def _whole_step(self, rows: Tensor, key: Hashable = None) -> None:
        self.gradient(key, rows)
        self.apply(self.norm())

    # -- without gradients -------------------------------------------------------------------

    def outputs(self, inputs: MakeInputs, count: int, size: int) -> Tensor:
        """Outputs float32 (count, outputs) for rows 0 to ``count``, ``size`` rows at a time."""
        own = range(count) if self._channel is None else self._channel.span(count)
        rows = [slice(i, min(i + size, own.stop)) for i in range(own.start, own.stop, size)]
        with torch.no_grad(), self._autocast():
            parts = [self.network(inputs(i, part)) for i, part in enumerate(rows)]
        if self._channel is None or not count:
            return torch.cat(parts) if parts else torch.empty(0, 1, device=self.device)
        found = torch.zeros(count, self.network.outputs, device=self.device)
        if parts:
            found[own.start : own.stop] = torch.cat(parts)
        self._channel.sum(found)  # zeros but for one rank in every row
        return found

    # -- figures -----------------------------------------------------------------------------

    def end_epoch(self, steps: int) -> dict[str, float]:
        """Means by name over the ``steps`` since the last call. Raises DivergedError.

        This is where the host waits for the device.
        """
        with self.on_stream():
            if self._channel is not None:
                # Each has its share of the means; the gradient's norm all of them have alike.
                shared = self._sums[:-1].clone()
                self._channel.sum(shared)
                self._sums[:-1] = shared
            sums = self._sums.tolist()
            self._sums.zero_()
        means = {name: total / steps for name, total in zip(self._names, sums, strict=True)}
        if not np.isfinite([means["loss"], means["gradient_norm"]]).all():
            raise DivergedError(
                f"loss {means['loss']:g} with gradient norm {means['gradient_norm']:g}"
            )
        self._past.append((steps, means))
        return means

    def figures(self) -> dict[str, float]:
        """Means by name over all steps since ``begin``; empty where there was none."""
        steps = sum(count for count, _ in self._past)
        if not steps:
            return {}
        return {
            name: sum(count * means[name] for count, means in self._past) / steps
            for name in self._names
        }

    # -- streams -----------------------------------------------------------------------------

    def on_stream(self) -> AbstractContextManager[object]:
        """Work inside goes to this network's stream."""
        return nullcontext() if self.stream is None else torch.cuda.stream(self.stream)

    def wait(self) -> None:
        """Let this network's stream see what the current stream has done."""
        if self.stream is not None:
            self.stream.wait_stream(torch.cuda.current_stream(self.device))

    def join(self) -> None:
        """Let the current stream see what this network's stream has done."""
        if self.stream is not None:
            torch.cuda.current_stream(self.device).wait_stream(self.stream)

    def _autocast(self) -> AbstractContextManager[object]:
        # No cache: each weight is read once per pass, and a graph must not keep one from outside.
        if self._precision == torch.float32:
            return nullcontext()
        return torch.autocast(self.device.type, self._precision, cache_enabled=False)


def minibatches(order: Tensor, size: int | None) -> Iterator[Tensor]:
    """Equal shares of about ``size`` rows of ``order`` (N,); none is tiny; None: all at once."""
    yield from order.tensor_split(max(1, round(len(order) / (size or len(order)))))
