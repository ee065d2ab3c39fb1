"""The learned policy as a planner: sampled or greedy actions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.navigation import Observation, action_table
from lndrl.planners.interface import episode_generator
from lndrl.policy import PolicyRunner


class PolicyPlanner:
    """Takes the actions of a policy network.

    Samples them as in training, or takes the likeliest when ``greedy``; a ``temperature`` below 1
    prefers the likelier ones, as if the network's logits were divided by it. Every episode samples
    from its own generator (not from one per batch as actors do), so that the noise of an episode
    does not depend on which others are still running. ``probabilities`` (B, A) are those of the
    last step, as it drew from them: for whoever shows what it thought of.
    """

    def __init__(
        self,
        runner: PolicyRunner,
        name: str = "policy",
        greedy: bool = False,
        temperature: float = 1.0,
    ) -> None:
        self.name = name
        self.greedy = greedy
        self.temperature = temperature
        self._runner = runner
        self._actions = action_table(runner.config.task)
        self._generators: list[np.random.Generator] = []
        self._said: NDArray[np.floating] = np.zeros((0, len(self._actions)), np.float32)

    @classmethod
    def load(
        cls,
        name: str,
        config: RunConfig,
        weights: bytes,
        greedy: bool = False,
        temperature: float = 1.0,
    ) -> PolicyPlanner:
        """Planner from a weights blob; raises UserError when it does not fit ``config``."""
        runner = PolicyRunner(config)
        runner.load(weights)
        return cls(runner, name, greedy, temperature)

    def renew(self, weights: bytes) -> None:
        """Act with other weights from now on; raises UserError when they are of another network."""
        self._runner.load(weights)

    @property
    def probabilities(self) -> NDArray[np.floating]:
        """Of the actions in the last step, at the temperature unless ``greedy``."""
        scores = self._said / (1.0 if self.greedy else self.temperature)
        shares: NDArray[np.floating] = np.exp(scores - scores.max(axis=1, keepdims=True))
        return shares / shares.sum(axis=1, keepdims=True)

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """See ``Planner.reset``."""
        self._generators = [episode_generator(seed, world) for world in worlds]

    def act(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """See ``Planner.act``."""
        return self._actions[self.scores(observation, rows).argmax(axis=1)]

    def scores(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.floating]:
        """Scores (B, A) of the actions, of which ``act`` takes the one with the largest.

        Log-probabilities at the temperature but for a constant, with this step's noise, or as they
        are when ``greedy``: in their order actions are drawn without putting back. Every call draws
        anew.
        """
        scores: NDArray[np.floating] = self._runner.log_probabilities(observation)
        self._said = scores
        if not self.greedy:
            # Gumbel trick: the largest of log p + noise is a draw from p.
            noise = [self._generators[row].gumbel(size=scores.shape[1]) for row in rows]
            scores = scores / self.temperature + noise
        return scores
