"""Entry of one actor or evaluator process; spawned by ``actors.fleet``.

Only the standard library, and what needs no more, is imported at the top: thread limits must
stand in the environment before NumPy, numba or torch are loaded.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lndrl.machine.cores import THREAD_VARIABLES
from lndrl.machine.memory import return_large_blocks
from lndrl.machine.signals import stop_handler, unblock

if TYPE_CHECKING:
    from lndrl.config import TransportConfig
    from lndrl.transport import Security

LEAVE_WITHIN = 1.5
"""Seconds between a request to stop and a hard exit; only an unfinished chunk is lost."""

PARENT_POLL = 0.5


@dataclass(frozen=True)
class WorkerOptions:
    """What a worker process is told: plain values that survive a spawn.

    ``worlds`` None leaves the number to the learner's configuration, where auto means as fits a
    fleet of ``siblings`` actors. ``patient`` makes an
    unreachable learner something to wait for rather than an error. ``parent`` is the process
    without which the worker ends. ``security`` holds the fields of a ``transport.Security``; it
    comes through a pipe, because command lines and environments can be read by others. ``ledger``:
    file that notes every upload. ``lease``: s of silence after which the learner gives this actor
    up; None as usual. ``trusted``: modules that this worker may import own parts from. ``role``:
    actor or evaluator; of an evaluator ``worlds``, ``siblings``, ``device`` and ``ledger`` say
    nothing.
    """

    endpoint: str
    actor_id: str
    worlds: int | None
    siblings: int
    device: str
    patient: bool
    parent: int
    namespace: str = ""
    security: dict[str, Any] | None = field(default=None, repr=False)
    ledger: str | None = None
    lease: float | None = None
    trusted: tuple[str, ...] = ()
    role: str = "actor"


class Report:
    """Sends what happened to the fleet as JSON, one message per event."""

    def __init__(self, channel: Connection) -> None:
        self._channel = channel
        self.failed = False  # whether an error was among them

    def __call__(self, event: str, text: str = "") -> None:
        """Send; a fleet that is gone is not an error, the parent watch ends this process."""
        self.failed |= event == "error"
        try:
            self._channel.send_bytes(json.dumps([event, text]).encode())
        except OSError:
            return


def main(options: WorkerOptions, channel: Connection) -> None:
    """Run an actor or evaluator until the learner is done or a signal asks to stop.

    Ends the process.

    Exit codes: 0 done or asked to stop, 2 an error that the user can mend (sentence sent to the
    fleet), 1 anything else (traceback on standard error).
    """
    for name in THREAD_VARIABLES:
        os.environ[name] = "1"
    return_large_blocks()
    stop = threading.Event()
    with stop_handler(lambda *_: stop.set()):
        # The fleet spawns with these blocked, so that none arrives before there is a handler.
        unblock()
        threading.Thread(target=_leave_in_time, args=(stop, options.parent), daemon=True).start()
        try:
            code = _run(options, stop, Report(channel))
        except Exception:
            traceback.print_exc()
            code = 1
        with suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        # Everything is closed. Taking the interpreter apart beside zenoh's and torch's threads can
        # take seconds, and the daemon thread that bounds them no longer runs by then.
        os._exit(code)


def _run(options: WorkerOptions, stop: threading.Event, report: Report) -> int:
    """Do the work of the role inside this process; returns the exit code."""
    from lndrl.errors import UserError

    try:
        from lndrl.config import TransportConfig
        from lndrl.extensions import trust_modules
        from lndrl.transport import Security

        trust_modules(*options.trusted)
        transport = TransportConfig(endpoint=options.endpoint, namespace=options.namespace)
        if options.lease is not None:
            transport = transport.model_copy(update={"lease": options.lease})
        security = None if options.security is None else Security(**options.security)
        work = {"actor": _act, "evaluator": _validate}[options.role]
        work(options, transport, security, stop, report)
    except UserError as error:
        report("error", str(error))
        return 2
    return 0 if not report.failed else 2


def _act(
    options: WorkerOptions,
    transport: TransportConfig,
    security: Security | None,
    stop: threading.Event,
    report: Report,
) -> None:
    """An actor, until the learner is done or ``stop`` is set."""
    from actors.actor import Actor
    from lndrl.transport import open_actor

    endpoint = open_actor(options.endpoint, transport, security)
    with _closing(endpoint.close, stop, report):
        if options.ledger is not None:
            endpoint.keep_book(Path(options.ledger))
        actor = Actor(
            endpoint,
            actor_id=options.actor_id,
            worlds=options.worlds,
            siblings=options.siblings,
            device=options.device,
            patient=options.patient,
            alone=True,
            on_event=report,
        )
        actor.run(stop)
        if actor.done:
            report("done")


def _validate(
    options: WorkerOptions,
    transport: TransportConfig,
    security: Security | None,
    stop: threading.Event,
    report: Report,
) -> None:
    """An evaluator, until the learner is done or ``stop`` is set."""
    from actors.evaluator import Evaluator
    from lndrl.transport import open_evaluator

    endpoint = open_evaluator(options.endpoint, transport, security)
    with _closing(endpoint.close, stop, report):
        evaluator = Evaluator(
            endpoint, evaluator_id=options.actor_id, patient=options.patient, on_event=report
        )
        evaluator.run(stop)
        if evaluator.done:
            report("done")


@contextmanager
def _closing(close: Callable[[], None], stop: threading.Event, report: Report) -> Iterator[None]:
    """Close in the end; an error is reported before, as closing may take longer than LEAVE_WITHIN.

    After a stop an error is none any more: whoever asked to stop may be what it is about.
    """
    from lndrl.errors import UserError

    try:
        yield
    except UserError as error:
        if not stop.is_set():
            report("error", str(error))
    finally:
        stop.set()
        close()


def _leave_in_time(stop: threading.Event, parent: int) -> None:
    """Daemon thread: stop when the parent is gone, and never linger after a stop."""
    while not stop.wait(PARENT_POLL):
        if os.getppid() != parent:
            stop.set()
    time.sleep(LEAVE_WITHIN)
    # Still here: inside a long compilation or a blocked upload. Nothing is left to save.
    os._exit(0)
