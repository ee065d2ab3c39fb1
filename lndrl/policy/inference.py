"""Acting: from observations to actions and their log-probabilities."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.navigation import Observation
from lndrl.policy.inputs import prepare, supports_sparse
from lndrl.policy.networks import build_policy
from lndrl.policy.weights import load_into


class PolicyRunner:
    """A policy without gradients; the weights can be replaced at any time between calls."""

    def __init__(self, config: RunConfig, device: str = "cpu") -> None:
        self.config = config
        self.device = device
        self.network = build_policy(config).to(device).requires_grad_(False).eval()
        self._freeze()

    def load(self, blob: bytes) -> None:
        """Replace the weights; raises UserError when they are of another network."""
        load_into(self.network, blob)
        self._freeze()

    def log_probabilities(self, observation: Observation) -> NDArray[np.float32]:
        """Log-probabilities (B, actions) for observations (B,)."""
        with torch.inference_mode():
            logits = self.network(prepare(observation, self.config, self.device))
            return torch.log_softmax(logits.float(), dim=1).cpu().numpy()

    def act(
        self, observation: Observation, rng: np.random.Generator, greedy: bool = False
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Actions uint8 (B,) and their log-probabilities float32 (B,).

        Sampled by the Gumbel trick from ``rng``, or the most likely ones when ``greedy``.
        """
        log_probabilities = self.log_probabilities(observation)
        noise = 0.0 if greedy else rng.gumbel(size=log_probabilities.shape)
        scores = log_probabilities + noise
        action = scores.argmax(axis=1)
        chosen = np.take_along_axis(log_probabilities, action[:, None], axis=1)[:, 0]
        return action.astype(np.uint8), chosen

    def _freeze(self) -> None:
        if self.device == "cpu" and supports_sparse(self.config):
            self.network.map_encoder.freeze()
