"""Acting by torch on the CPU: in bfloat16, and with parts of a user's own."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.navigation import Observation
from lndrl.policy.arrays import ArrayInputs, array_inputs, supports_sparse
from lndrl.policy.inputs import as_tensors
from lndrl.policy.networks import Network, build_policy
from lndrl.policy.tensors import load_into


class ModulePolicy:
    """Evaluates the torch modules of ``config``, with products in ``bfloat16`` where asked for."""

    def __init__(self, config: RunConfig, bfloat16: bool = False) -> None:
        self._config, self._bfloat16 = config, bfloat16
        self.network = build_policy(config, initialize=False).requires_grad_(False).eval()
        self._freeze()

    def load(self, blob: bytes) -> None:
        """See ``PolicyRunner``."""
        load_into(self.network, blob, config=self._config)
        self._freeze()

    def log_probabilities(self, observation: Observation) -> NDArray[np.float32]:
        """See ``PolicyRunner``."""
        return self.answer(array_inputs(observation, self._config, exact=not self._bfloat16))

    def answer(self, inputs: ArrayInputs) -> NDArray[np.float32]:
        """Log-probabilities (N, actions)."""
        tensors = as_tensors(inputs)
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=self._bfloat16):
            return torch.log_softmax(self._acting(tensors).float(), dim=1).numpy()

    def _freeze(self) -> None:
        """Make what acts from the weights, once for all calls until the next ones."""
        self._acting: Network = self.network
        if self._bfloat16:
            self._acting = self.network.coarse()
        if supports_sparse(self._config):
            self._acting.freeze()
