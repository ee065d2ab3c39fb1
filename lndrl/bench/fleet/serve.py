"""The learner of a fleet bench, in a process of its own: a real one, or one that learns nothing.

Its parent talks to it through a pipe, in JSON: ``publish`` asks for new weights, ``stop`` ends it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Event, Thread
from typing import Any

from learner.intake.ingest import Chunk
from learner.learner import Learner
from learner.ppo.batch import Batch
from lndrl.config import RunConfig
from lndrl.policy import to_bytes
from lndrl.transport import LearnerEndpoint

Tell = Callable[..., None]

_NEVER = 10**9  # updates between two checkpoints: a drain has nothing to keep


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


def main(config: dict[str, Any], folder: str, drain: bool, channel: Connection) -> None:
    """Serve until told to stop; entry of the process."""
    from learner.run.record import quiet_tensorboard
    from lndrl.config import parse_config
    from lndrl.machine.files import raise_file_limit
    from lndrl.transport import open_learner

    def tell(kind: str, *what: Any) -> None:
        channel.send_bytes(json.dumps([kind, *what]).encode())

    run = parse_config(config, "bench fleet")
    raise_file_limit()
    quiet_tensorboard()
    door = open_learner(run.transport)
    try:
        _serve(run, Path(folder), door, drain, channel, tell)
    finally:
        door.close()


def _serve(
    config: RunConfig,
    folder: Path,
    door: LearnerEndpoint,
    drain: bool,
    channel: Connection,
    tell: Tell,
) -> None:
    from learner.status import StatusThread

    if drain:
        rare = config.learner.model_copy(update={"checkpoint_interval": _NEVER})
        config = config.model_copy(update={"learner": rare})
    stop = Event()
    learner = (Drain if drain else Served)(config, folder, door, quiet=True)
    learner.tell = tell
    wanted = Event()
    if isinstance(learner, Drain):
        learner.wanted = wanted
    status = StatusThread(learner)

    def listen() -> None:
        try:
            while (word := json.loads(channel.recv_bytes())) != "stop":
                if word == "publish":
                    wanted.set()
        except (EOFError, OSError):
            pass
        stop.set()

    Thread(target=listen, name="parent", daemon=True).start()
    status.start()
    tell("ready")
    try:
        learner.run(stop)
    finally:
        status.stop()
        learner.close()
    tell("ended", learner.accounts.totals())
