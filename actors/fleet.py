"""A local fleet: N actor processes that are restarted when they die.

    fleet = Fleet("tcp/127.0.0.1:7447", count=2)
    fleet.start()
    while fleet.poll() is None: ...
    fleet.stop()

Workers are spawned, never forked: neither zenoh's runtime nor torch survives a fork.
"""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import re
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import TYPE_CHECKING

from actors import worker
from actors.worker import WorkerOptions
from lndrl.extensions import trusted_modules
from lndrl.machine.signals import starting_child, stop_handler
from lndrl.wording import counted

if TYPE_CHECKING:
    from lndrl.transport import Security

BACKOFF_FIRST, BACKOFF_MOST = 0.5, 8.0
HEALTHY_AFTER = 60.0
"""Seconds of life after which a worker's earlier deaths no longer lengthen its backoff."""

LONGEST_HOST = 40
"""Letters; with process and number an actor's name stays below 64 (``messages.IDENTIFIER``)."""
STOP_WITHIN = worker.LEAVE_WITHIN + 1.0
POLL_INTERVAL = 0.2
LOGGER = logging.getLogger("lndrl.actors")


@dataclass
class _Slot:
    """One place in the fleet: its process, if any, and what became of the ones before."""

    index: int
    actor_id: str
    process: SpawnProcess | None = None
    channel: Connection | None = None
    started: float = 0.0
    failures: int = 0
    restart_at: float = 0.0
    joined: bool = False
    done: bool = False


class Fleet:
    """N supervised actor processes against the learner at ``endpoint``.

    ``worlds`` None leaves the number of worlds per process to the learner's configuration.
    ``log`` gets one line per event, the file ``ledger`` one per upload. ``lease``: s of silence
    after which the learner gives an actor up. ``role``: actor or evaluator. Nothing here blocks
    except ``stop`` (at most 3 s). ``grow`` and ``shrink`` change N while the fleet runs; call all
    from one thread.
    ``error`` holds the sentence that ended the fleet, ``restarts`` counts replaced processes.
    """

    def __init__(
        self,
        endpoint: str,
        count: int,
        worlds: int | None = None,
        device: str = "cpu",
        log: Callable[[str], None] = LOGGER.info,
        security: Security | None = None,
        namespace: str = "",
        ledger: Path | None = None,
        lease: float | None = None,
        role: str = "actor",
    ) -> None:
        if count < 1:
            raise ValueError(f"a fleet needs at least 1 actor, not {count}")
        letter = "" if role == "actor" else role[0]  # an evaluator is no namesake of an actor
        name = f"{_plain(socket.gethostname())}-{os.getpid()}{letter}"
        self.restarts = 0
        self.error = ""
        self._endpoint, self._worlds, self._device, self._log = endpoint, worlds, device, log
        self._namespace, self._lease, self._role = namespace, lease, role
        # Plain, because a worker may import nothing before it has limited its threads.
        self._security = None if security is None else dict(vars(security))
        self._name = name
        self._ledger = None if ledger is None else str(ledger.absolute())
        self._slots = [_Slot(i, f"{name}-{i:03d}") for i in range(count)]
        self._leaving: list[tuple[_Slot, float]] = []  # with the monotonic s of patience's end
        self._joined = False  # has any worker ever been welcomed

    def start(self) -> None:
        """Spawn the first worker; ``poll`` spawns the others once it has joined.

        The first one compiles the kernels that a fresh installation lacks; the others find them
        in the cache and need neither the time nor the memory.
        """
        self._spawn(self._slots[0])

    def __len__(self) -> int:
        """N, whether they run already or not."""
        return len(self._slots)

    def settled(self) -> bool:
        """Whether all N actors have joined the learner and none is on its way out."""
        return not self._leaving and all(slot.joined for slot in self._slots)

    def grow(self) -> str:
        """One actor more, which ``poll`` spawns; returns its id."""
        taken = {slot.index for slot in self._slots}
        taken |= {slot.index for slot, _ in self._leaving}
        index = next(i for i in range(len(taken) + 1) if i not in taken)
        self._slots.append(_Slot(index, f"{self._name}-{index:03d}"))
        return self._slots[-1].actor_id

    def shrink(self) -> str | None:
        """One actor less, the newest; returns its id, None where only one is left.

        It is asked to stop and drops the chunk it is at; ``poll`` or ``stop`` sees it off.
        """
        if len(self._slots) == 1:
            return None
        slot = self._slots.pop()
        if slot.process is not None:
            slot.process.terminate()
            self._leaving.append((slot, time.monotonic() + STOP_WITHIN))
        return slot.actor_id

    def pids(self) -> list[int]:
        """Process ids of the workers that live now; last those that have been asked to stop."""
        leaving = [slot for slot, _ in self._leaving]
        processes = [slot.process for slot in [*self._slots, *leaving]]
        return [p.pid for p in processes if p is not None and p.pid is not None and p.is_alive()]

    def poll(self) -> int | None:
        """Look after the workers; None while the fleet goes on, else its exit code.

        0: every worker reports that the run is done. 2: a worker met an error that the user can
        mend, see ``error``; the other workers still run until ``stop``.
        """
        self._see_off()
        for slot in self._slots:
            self._hear(slot)
            if not slot.done and slot.process is not None and not slot.process.is_alive():
                self._hear(slot)  # its last words may have come in between
                self._bury(slot)
            if self.error:
                return 2
            fresh = slot.started == 0.0
            due = self._joined if fresh else time.monotonic() >= slot.restart_at
            if not slot.done and slot.process is None and due:
                self.restarts += not fresh
                self._spawn(slot)
        return 0 if all(slot.done for slot in self._slots) else None

    def stop(self) -> None:
        """End every worker: SIGTERM, and SIGKILL for what is left after a short grace."""
        slots = [*self._slots, *(slot for slot, _ in self._leaving)]
        running = [slot.process for slot in slots if slot.process is not None]
        for process in running:
            process.terminate()
        deadline = time.monotonic() + STOP_WITHIN
        for process in running:
            process.join(max(0.0, deadline - time.monotonic()))
            if process.is_alive():
                process.kill()
                process.join()
        for slot in slots:
            self._release(slot)
        self._leaving = []

    def _see_off(self) -> None:
        """Bury the workers that ``shrink`` has asked to stop, and kill those that linger."""
        for slot, deadline in list(self._leaving):
            assert slot.process is not None
            if slot.process.is_alive():
                if time.monotonic() > deadline:
                    slot.process.kill()
                continue
            self._release(slot)
            self._leaving = [other for other in self._leaving if other[0] is not slot]

    def _spawn(self, slot: _Slot) -> None:
        context = multiprocessing.get_context("spawn")
        options = WorkerOptions(
            endpoint=self._endpoint,
            actor_id=slot.actor_id,
            worlds=self._worlds,
            siblings=len(self._slots),
            device=self._device,
            patient=self._joined,
            parent=os.getpid(),
            namespace=self._namespace,
            security=self._security,
            ledger=self._ledger,
            lease=self._lease,
            trusted=trusted_modules(),
            role=self._role,
        )
        slot.channel, theirs = context.Pipe(duplex=False)
        slot.process = context.Process(
            target=worker.main, args=(options, theirs), name=slot.actor_id, daemon=True
        )
        with starting_child():
            slot.process.start()
        theirs.close()  # ours is then the only copy, and reading ends when the worker does
        slot.started = time.monotonic()

    def _hear(self, slot: _Slot) -> None:
        """Take in what a worker has reported."""
        channel = slot.channel
        with suppress(EOFError, OSError):
            while channel is not None and channel.poll():
                event, text = json.loads(channel.recv_bytes())
                if event == "error":
                    self.error = self.error or text
                    continue
                slot.joined |= event == "joined"
                self._joined |= slot.joined
                slot.done |= event == "done"
                self._log(f"{self._role} {slot.index} {event}" + (f": {text}" if text else ""))

    def _bury(self, slot: _Slot) -> None:
        """A worker ended without the run being done: plan its replacement."""
        assert slot.process is not None
        code = slot.process.exitcode
        lived = time.monotonic() - slot.started
        slot.failures = 1 if lived > HEALTHY_AFTER else slot.failures + 1
        wait = min(BACKOFF_MOST, BACKOFF_FIRST * 2 ** (slot.failures - 1))
        slot.restart_at = time.monotonic() + wait
        self._release(slot)
        if not self.error:
            self._log(f"{self._role} {slot.index} {_cause(code)}; another starts in {wait:g} s")

    def _release(self, slot: _Slot) -> None:
        if slot.process is not None:
            slot.process.join()
            slot.process.close()
        if slot.channel is not None:
            slot.channel.close()
        slot.process = slot.channel = None
        slot.joined = False


def _plain(host: str) -> str:
    """``host`` as the first part of an actor's name, of which learners take 64 letters."""
    return re.sub(r"[^A-Za-z0-9.-]", "-", host).lstrip(".-")[:LONGEST_HOST] or "host"


def run_fleet(
    endpoint: str,
    count: int,
    worlds: int | None = None,
    device: str = "cpu",
    security: Security | None = None,
    namespace: str = "",
    ledger: Path | None = None,
    role: str = "actor",
) -> int:
    """Run N actors in the foreground until the run is done, Ctrl-C, SIGTERM or SIGHUP.

    ``role`` evaluator: evaluators, which know nothing of worlds, devices and ledgers.
    Returns the exit code: 0 done or asked to stop, 2 an error that the user can mend, whose
    sentence is printed once. No process is left behind. Call from the main thread.
    """
    stop = threading.Event()
    fleet = Fleet(
        endpoint, count, worlds, device, log=_print, security=security, namespace=namespace,
        ledger=ledger, role=role,
    )  # fmt: skip
    code: int | None = None
    with stop_handler(lambda *_: stop.set()):
        try:
            fleet.start()
            while code is None and not stop.is_set():
                code = fleet.poll()
                stop.wait(POLL_INTERVAL)
        finally:
            fleet.stop()
    if fleet.error:
        with suppress(OSError):
            print(fleet.error, file=sys.stderr, flush=True)
    elif code is None:
        _print(f"stopped {counted(count, role)}")
    return code or 0


def _print(line: str) -> None:
    with suppress(OSError):  # a closed terminal is no reason to end
        print(f"{time.strftime('%H:%M:%S')} {line}", file=sys.stderr, flush=True)


def _cause(code: int | None) -> str:
    if code is not None and code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended with exit code {code}"
