"""A trained policy for whoever has Gymnasium's observations: ``load_policy(folder).act(...)``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.navigation.terms import as_tested
from lndrl.policy import (
    ArrayInputs,
    driven_at,
    local_policy,
    pooling_factor,
    supports_sparse,
)
from lndrl.policy import load_policy as read_policy
from lndrl.policy.sparse import MapStructure, drawn_structure

Observations = Mapping[str, NDArray[np.floating]]


class TrainedPolicy:
    """Acts on observations of ``lndrl/Navigation-v0``, one or a batch of them, on the CPU.

    Computes what ``PolicyRunner`` computes for the same moment, from the drawn pedestrian map
    where that one has the people. ``config`` is what the policy was trained under, without reward
    terms of one's own: what an environment must have for its observations to mean the same.
    ``temperature`` is what the weights say they are meant to be sampled at, else 1. ``seed`` starts
    the draws.
    """

    def __init__(self, config: RunConfig, weights: bytes, seed: int | None = None) -> None:
        """Raises UserError when ``weights`` do not fit the network of ``config``."""
        self.config = as_tested(config)
        self.temperature = driven_at(weights)
        self._policy = local_policy(config)
        self._policy.load(weights)
        self._sparse = supports_sparse(config)
        self._generator = np.random.default_rng(seed)
        task, beams = config.task, config.world.laser.beams
        self._shapes = {
            "scan": (task.scan_frames, beams),
            "pedestrians": (3, task.map_cells, task.map_cells),
            "goal": (6,),
        }

    def act(
        self, observation: Observations, greedy: bool = False, temperature: float | None = None
    ) -> np.int64 | NDArray[np.int64]:
        """An action number for one observation, (B,) of them for a batch.

        Drawn at ``temperature``, by default the policy's own, or the likeliest when ``greedy``: 1
        is as in training, below prefers the likelier ones. Raises ValueError for arrays of other
        shapes than an environment of ``config`` has.
        """
        scores: NDArray[np.floating] = self.log_probabilities(observation)
        if not greedy:
            # Gumbel trick: the largest of log p + noise is a draw from p.
            warmth = self.temperature if temperature is None else temperature
            scores = scores / warmth + self._generator.gumbel(size=scores.shape)
        action: np.int64 | NDArray[np.int64] = scores.argmax(axis=-1)
        return action

    def log_probabilities(self, observation: Observations) -> NDArray[np.float32]:
        """Log-probabilities (actions,) for one observation, (B, actions) for a batch.

        They are the network's, at temperature 1.
        """
        lead, arrays = self._checked(observation)
        return self._policy.answer(self._inputs(arrays)).reshape(*lead, -1)

    def _checked(
        self, observation: Observations
    ) -> tuple[tuple[int, ...], dict[str, NDArray[np.floating]]]:
        """The leading shape, () or (B,), and the arrays with (B,) in front."""
        if not isinstance(observation, Mapping) or not set(self._shapes) <= set(observation):
            raise ValueError(f"an observation is a dict with {', '.join(self._shapes)}")
        arrays = {name: np.asarray(observation[name]) for name in self._shapes}
        goal = arrays["goal"].shape
        lead = goal[:-1]
        for name, shape in self._shapes.items():
            if arrays[name].shape != (*lead, *shape) or len(lead) > 1:
                raise ValueError(
                    f"{name} must have the shape {shape}, or (B, {', '.join(map(str, shape))}) for "
                    f"a batch, not {arrays[name].shape}; make the environment with "
                    "config=policy.config"
                )
        return lead, {name: a.reshape(-1, *self._shapes[name]) for name, a in arrays.items()}

    def _inputs(self, arrays: Mapping[str, NDArray[np.floating]]) -> ArrayInputs:
        # Through the counts that the shares were made of: the same bits as in training.
        counts = np.rint(arrays["scan"].astype(np.float64) * SCAN_COUNTS).astype(np.uint16)
        scan = (counts * np.float32(1.0 / SCAN_COUNTS)).reshape(len(counts), -1)
        people = self._people(arrays["pedestrians"].astype(np.float32))
        return ArrayInputs(scan, arrays["goal"].astype(np.float32), people)

    def _people(self, maps: NDArray[np.float32]) -> NDArray[np.float32] | MapStructure | None:
        if not self.config.network.pedestrian_map:
            return None
        if self._sparse:
            return drawn_structure(maps, pooling_factor(self.config))
        return maps


def load_policy(path: Path | str, seed: int | None = None) -> TrainedPolicy:
    """The policy of a run folder (the best validated one, else the newest), or of a policy file.

    ``shipped`` is the one that comes with the program.

    Raises UserError naming the path when nothing usable is there.
    """
    config, weights = read_policy(path)
    return TrainedPolicy(config, weights, seed)
