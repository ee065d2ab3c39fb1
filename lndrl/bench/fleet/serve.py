"""The process of a fleet bench's learner: a real one, or one that learns nothing.

Its parent talks to it through a pipe, in JSON: ``publish`` asks for new weights, ``stop`` ends it.
"""

from __future__ import annotations

import json
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from lndrl.config import RunConfig, parse_config
from lndrl.machine.files import raise_file_limit

if TYPE_CHECKING:
    from lndrl.bench.fleet.drain import Tell
    from lndrl.transport import LearnerEndpoint

_NEVER = 10**9  # updates between two checkpoints: a drain has nothing to keep


def main(
    config: dict[str, Any], folder: str, drain: bool, namespace: str, channel: Connection
) -> None:
    """Serve until told to stop; entry of the process. ``namespace``: of its host, if not here."""
    from learner.run.record import quiet_tensorboard
    from lndrl.chaos.wire import enter
    from lndrl.transport import Security, open_learner

    def tell(kind: str, *what: Any) -> None:
        channel.send_bytes(json.dumps([kind, *what]).encode())

    run = parse_config(config, "bench fleet")
    raise_file_limit()
    quiet_tensorboard()
    if namespace:
        enter(namespace)
    # Nobody else is in a namespace of ours.
    door = open_learner(run.transport, security=Security("learner", insecure=bool(namespace)))
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
    from lndrl.bench.fleet.drain import Drain, Served

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
