"""Acting: from observations to actions and their log-probabilities."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.kernels import expect
from lndrl.navigation import Observation
from lndrl.navigation.pedestrian_map import collect_many
from lndrl.policy import sparse
from lndrl.policy.acting import DevicePolicy
from lndrl.policy.device import resolve_device
from lndrl.policy.inputs import prepare, supports_sparse
from lndrl.policy.networks import Network, build_policy
from lndrl.policy.weights import load_into


class PolicyRunner:
    """A policy without gradients; the weights can be replaced at any time between calls.

    ``device`` is cpu, cuda or cuda:N; on the CPU the evaluation is sparse where it can be.
    ``bfloat16`` does the products in bfloat16, which pays on processors that have instructions
    for it and costs about two decimal digits of the log-probabilities. Raises UserError when the
    device is not there.
    """

    def __init__(
        self,
        config: RunConfig,
        device: str = "cpu",
        bfloat16: bool = False,
        initialize: bool = True,
    ) -> None:
        self.config = config
        self.bfloat16 = bfloat16
        self.device = resolve_device(device)
        self.network = build_policy(config, initialize).to(self.device).requires_grad_(False).eval()
        self._remote: DevicePolicy | None = None
        if self.device.type != "cpu":
            precision = torch.bfloat16 if bfloat16 else torch.float32
            self._remote = DevicePolicy(self.network, config, precision)
        elif supports_sparse(config):
            expect(collect_many, *sparse.KERNELS)
        self._freeze()

    def load(self, blob: bytes) -> None:
        """Replace the weights; raises UserError when they are of another network."""
        load_into(self.network, blob, config=self.config)
        self._freeze()

    def log_probabilities(self, observation: Observation) -> NDArray[np.float32]:
        """Log-probabilities (B, actions) for observations (B,)."""
        if self._remote is not None:
            return self._remote.log_probabilities(observation)
        inputs = prepare(observation, self.config, exact=not self.bfloat16)
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=self.bfloat16):
            return torch.log_softmax(self._acting(inputs).float(), dim=1).numpy()

    def act(
        self,
        observation: Observation,
        rng: np.random.Generator,
        greedy: bool = False,
        given: NDArray[np.integer] | None = None,
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Actions uint8 (B,) and their log-probabilities float32 (B,).

        Sampled by the Gumbel trick from ``rng``, or the most likely ones when ``greedy``. Where
        ``given`` (B,) is not negative, that action is taken whatever the policy says of it.
        """
        log_probabilities = self.log_probabilities(observation)
        noise = 0.0 if greedy else rng.gumbel(size=log_probabilities.shape)
        scores = log_probabilities + noise
        action = scores.argmax(axis=1)
        if given is not None:
            action = np.where(given >= 0, given, action)
        chosen = np.take_along_axis(log_probabilities, action[:, None], axis=1)[:, 0]
        if given is not None:  # as unlikely as a float32 can say, and an upload may hold
            chosen = chosen.clip(min=np.float32(-100.0))
        return action.astype(np.uint8), chosen

    def _freeze(self) -> None:
        """Make what acts from the weights, once for all calls until the next ones."""
        self._acting: Network = self.network
        if self.bfloat16 and self.device.type == "cpu":
            self._acting = self.network.coarse()
        if self.device.type == "cpu" and supports_sparse(self.config):
            self._acting.freeze()
