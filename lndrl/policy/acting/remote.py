"""Acting on a GPU: one upload, one launch and one download for many worlds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lndrl.config import RunConfig
from lndrl.navigation import Observation
from lndrl.policy.acting.runner import Policy, local_policy
from lndrl.policy.compact import CompactObservation
from lndrl.policy.device import resolve_device
from lndrl.policy.graphs import EAGER_RUNS, Record, record_cuda_graph
from lndrl.policy.inputs import Inputs
from lndrl.policy.networks import Network, build_policy
from lndrl.policy.tensors import load_into

_MOST_BATCHES = 4  # sizes that have memory of their own; the oldest makes room


@dataclass
class _Batch:
    """Memory of one batch size: what the graph reads and writes, and its replay once recorded."""

    seen: CompactObservation
    answer: Tensor
    runs: int = 0
    replay: Callable[[], None] | None = None


class DevicePolicy:
    """Evaluates ``network`` where it is; its weights may change in place between calls.

    ``precision`` is the dtype of the products. ``record`` makes graphs; None where there are
    none to be had, and then every call runs its operations one by one.
    """

    def __init__(
        self,
        network: Network,
        config: RunConfig,
        precision: torch.dtype = torch.float32,
        record: Record | None = None,
    ) -> None:
        self.network = network
        self._config = config
        self._device = next(network.parameters()).device
        self._precision = precision
        if record is None and self._device.type == "cuda":
            record = partial(record_cuda_graph, torch.cuda.Stream(self._device))
        self._record = record
        self._batches: dict[int, _Batch] = {}

    def load(self, blob: bytes) -> None:
        """See ``PolicyRunner``."""
        load_into(self.network, blob, config=self._config)

    def log_probabilities(self, observation: Observation) -> NDArray[np.float32]:
        """Log-probabilities (B, actions) for observations (B,)."""
        batch = self._batch(observation)
        batch.seen.copy_(CompactObservation.view(observation))
        with torch.no_grad():
            if batch.replay is None and batch.runs >= EAGER_RUNS and self._record is not None:
                batch.replay = self._record(lambda: self._answer(batch))
            if batch.replay is None:
                batch.runs += 1
                self._answer(batch)
            else:
                batch.replay()
        # A copy, also where the device is the host: the next call writes there again.
        return batch.answer.cpu().numpy().copy()

    def _answer(self, batch: _Batch) -> None:
        kind = self._device.type
        lower = self._precision != torch.float32
        with torch.autocast(kind, self._precision, enabled=lower, cache_enabled=False):
            logits = self.network(Inputs(*batch.seen.expand(self._config.task)))
        batch.answer.copy_(torch.log_softmax(logits.float(), dim=1))

    def _batch(self, observation: Observation) -> _Batch:
        size = len(observation)
        if size not in self._batches:
            if len(self._batches) >= _MOST_BATCHES:
                del self._batches[next(iter(self._batches))]
            seen = CompactObservation.view(Observation.zeros_for(size, self._config))
            outputs = self.network.outputs
            answer = torch.empty(size, outputs, device=self._device)
            self._batches[size] = _Batch(seen.to(self._device), answer)
        return self._batches[size]


def policy_on(device: str, config: RunConfig, bfloat16: bool = False) -> Policy:
    """The policy of ``config`` on ``device``; raises UserError when that is not there."""
    place = resolve_device(device)
    if place.type == "cpu":
        return local_policy(config, bfloat16)
    network = build_policy(config, initialize=False).to(place).requires_grad_(False).eval()
    return DevicePolicy(network, config, torch.bfloat16 if bfloat16 else torch.float32)
