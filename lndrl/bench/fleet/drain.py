"""Learners for a fleet bench: one that tells when it publishes, and one that learns nothing."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Event

from learner.intake.ingest import Chunk
from learner.learner import Learner
from learner.ppo.batch import Batch
from lndrl.policy import to_bytes

Tell = Callable[..., None]


class Served(Learner):
    """A learner that says when it publishes a version: ``tell("published", version, moment)``."""

    tell: Tell

    def _publish(self) -> None:
        super()._publish()
        self.tell("published", self.counters.version, time.monotonic())


class Drain(Served):
    """Books every batch as trained without an update; publishes only when ``wanted`` is set."""

    wanted: Event
    blob: bytes | None = None

    def _update(self, batch: Batch, chunks: list[Chunk]) -> bool:
        self.figures, self.lag = {}, {"mean": 0.0, "max": 0}
        self._learned_in = self.stage.phase
        self.counters.steps += len(batch)
        self.counters.updates += 1
        self.accounts.train(self.counters.updates, [chunk.id for chunk in chunks])
        return True

    def _publish(self) -> None:
        if self.blob is None:
            self.blob = to_bytes(self.ppo.acting)
        elif not self.wanted.is_set():
            return
        else:
            self.wanted.clear()
            self.counters.version += 1
        self.ingest.weights_version = self.counters.version
        self.endpoint.publish_weights(self.counters.version, self.blob)
        self.tell("published", self.counters.version, time.monotonic())
