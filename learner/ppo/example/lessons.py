"""What a policy that imitates has met so far, with what the teacher says of it."""

from __future__ import annotations

import numpy as np

from learner.ppo.batch import Batch
from learner.ppo.example.mirror import mirror, mirrored_actions
from learner.ppo.example.vary import Variations
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.navigation import Observation


class Lessons:
    """The newest ``config.imitation.memory`` labelled states, oldest overwritten first.

    It is no part of a checkpoint: a run that is resumed while it imitates fills it anew. Raises
    UserError for more states than the system gives memory for.
    """

    def __init__(self, config: RunConfig) -> None:
        capacity, task = config.imitation.memory, config.task
        actions = len(task.linear_velocities) * len(task.angular_velocities)
        try:
            # Zeros of the system: what has not been filled takes no memory.
            self._seen = Observation.zeros_for(capacity, config)
            self._teacher = np.zeros((capacity, actions), np.float16)
        except (MemoryError, ValueError):  # more than there is, or than can be counted
            raise UserError(
                f"imitation.memory {capacity:,}: this machine has no memory for so many states; "
                "lower it"
            ) from None
        self._beams = config.world.laser.beams
        self._share = config.imitation.vary
        self._vary = Variations(config) if self._share > 0.0 else None
        self._images = mirrored_actions(config) if config.imitation.mirror else None
        self._none = Observation.zeros_for(0, config)
        self._next = 0
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, batch: Batch) -> None:
        """Keep the states of ``batch`` that the teacher has labelled."""
        if batch.teacher is None or batch.taught is None:
            return
        capacity = len(self._teacher)
        rows = np.flatnonzero(batch.taught)[-capacity:]
        places = (self._next + np.arange(len(rows))) % capacity
        self._seen.put(places, batch.observation.take(rows))
        self._teacher[places] = batch.teacher[rows]
        self._next = int(self._next + len(rows)) % capacity
        self._count = min(capacity, self._count + len(rows))

    def draw(self, count: int, rng: np.random.Generator) -> Batch:
        """``count`` states drawn at random, in rounds over all of them; there must be some.

        Every other one is mirrored, and a share of them varied, where that is wanted.
        """
        rounds = -(-count // self._count)
        rows = np.concatenate([rng.permutation(self._count) for _ in range(rounds)])[:count]
        seen, teacher = self._seen.take(rows), self._teacher[rows]
        if self._images is not None:
            seen.put(np.s_[::2], mirror(seen.take(np.s_[::2]), self._beams))
            teacher[::2] = teacher[::2, self._images]
        if self._vary is not None:
            chosen = np.flatnonzero(rng.random(count) < self._share)
            varied = seen.take(chosen)
            teacher[chosen] = self._vary(varied, rng)
            seen.put(chosen, varied)
        return Batch(
            trajectories=(),
            observation=seen,
            final_observation=self._none,
            action=np.zeros(count, np.int64),
            log_prob=np.zeros(count, np.float32),
            version=np.zeros(count, np.int64),
            teacher=teacher,
            taught=np.ones(count, np.float32),
        )

    def forget(self) -> None:
        """Give the memory back: imitation is over."""
        self._seen, self._teacher = self._none, self._teacher[:0].copy()
        self._next = self._count = 0
