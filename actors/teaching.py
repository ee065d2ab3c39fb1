"""The run's teacher beside the policy: it labels the states that are met, and may drive some.

It works on the cores of the actors while these simulate, and only in training: what is learned
drives without it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.navigation import Observation, action_table
from lndrl.navigation.trajectory import above_cheapest
from lndrl.planners import teacher_of
from lndrl.planners.rollouts import decide
from lndrl.policy import Guidance

KERNELS = (decide,)
"""What a teacher calls from Python."""

_LEFT_ALONE = -1  # the policy decides


class Teacher:
    """The planner that ``config.ppo.teacher`` names, for ``worlds`` worlds.

    Raises UserError for parameters that it does not have and a task that it cannot serve.
    """

    def __init__(self, config: RunConfig, worlds: int) -> None:
        self._planner = teacher_of(config)
        self._actions = action_table(config.task)
        self._rows = np.arange(worlds)
        self._labels = np.zeros((0, worlds, len(self._actions)), np.float16)
        self._driven = np.zeros(worlds, bool)
        self._planner.reset(config.seed, self._rows.tolist())

    def begin(self, steps: int, guidance: Guidance, rng: np.random.Generator) -> None:
        """Begin a chunk of T ``steps``; ``rng`` draws which worlds are driven in it."""
        worlds = len(self._rows)
        shape = (steps if guidance.labels else 0, worlds, len(self._actions))
        self._labels = np.zeros(shape, np.float16)
        self._driven = np.zeros(worlds, bool)
        if guidance.labels and guidance.drives > 0.0:
            self._driven = rng.random(worlds) < guidance.drives

    def teach(self, t: int, observation: Observation) -> NDArray[np.int64] | None:
        """Label ``observation`` (B,) of step ``t``, where labels are wanted.

        Returns the actions (B,) that it takes, -1 where the policy decides; None: everywhere.
        """
        if not len(self._labels):
            return None
        costs = self._planner.costs(observation, self._rows)
        self._labels[t] = above_cheapest(costs)
        if not self._driven.any():
            return None
        return np.where(self._driven, costs.argmin(axis=1), _LEFT_ALONE)

    def told(self, action: NDArray[np.integer], ended: NDArray[np.bool_]) -> None:
        """Hear what the robots (B,) were told, and where an episode ``ended`` with that."""
        if not len(self._labels):
            return
        self._planner.told(self._actions[action], self._rows)
        self._planner.begin(self._rows[ended])

    def labels(self) -> NDArray[np.float16]:
        """Of the chunk: costs above the cheapest (T, B, A), or (0, B, A) without labels."""
        return self._labels
