"""CPU of ``lndrl dashboard`` in a terminal of its own, while 300 actors are at work."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import psutil

from lndrl.bench.dashboard.crowd import history, snapshot
from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.evaluation.sweep.processes import this_program
from lndrl.machine.processes import end
from lndrl.transport import free_endpoint, open_learner

ACTORS = 300
HISTORY = 600
RATE = 2.0
"""Snapshots/s that the learner tells, each of which the viewer draws."""
SIZES = ((80, 24), (120, 40), (200, 60))
PATIENCE = 120.0
"""s until the first picture must be there."""
_HOME = b"\x1b[H"  # every picture begins with it


class _Nobody:
    """A learner's handlers: nobody comes but viewers."""

    def __getattr__(self, name: str) -> Any:
        raise UserError(f"bench dashboard: somebody else is at work here ({name})")


def measure(seconds: float) -> dict[str, Any]:
    """By size of the terminal: ``core_share`` of the viewer, over ``seconds`` once it draws.

    And ``pictures_per_second``, of which there must be as many as the learner tells. Raises
    UserError when the viewer ends or draws nothing.
    """
    endpoint = free_endpoint()
    door = open_learner(TransportConfig(endpoint=endpoint), "bench")
    stop = threading.Event()

    def talk() -> None:
        rows, turn = history(HISTORY), 0
        while not stop.wait(1.0 / RATE):
            turn += 1
            door.publish_status(snapshot(ACTORS, turn), rows)

    teller = threading.Thread(target=talk, name="bench-status", daemon=True)
    try:
        door.start(_Nobody())
        teller.start()
        return {
            f"{width}x{height}": _watch(endpoint, width, height, seconds) for width, height in SIZES
        }
    finally:
        stop.set()
        teller.join()
        door.close()


def _watch(endpoint: str, width: int, height: int, seconds: float) -> dict[str, float]:
    with _viewer(endpoint, width, height) as (process, terminal):
        _pictures(process, terminal, PATIENCE, least=3)
        program = psutil.Process(process.pid)
        began, before = time.monotonic(), sum(program.cpu_times()[:2])
        drawn = _pictures(process, terminal, seconds)
        took = time.monotonic() - began
        spent = sum(program.cpu_times()[:2]) - before
    return {"core_share": spent / took, "pictures_per_second": drawn / took}


@contextmanager
def _viewer(
    endpoint: str, width: int, height: int
) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    terminal, inside = pty.openpty()
    fcntl.ioctl(inside, termios.TIOCSWINSZ, struct.pack("HHHH", height, width, 0, 0))
    environment = this_program() | {"TERM": "xterm-256color", "COLORTERM": "truecolor"}
    for name in ("NO_COLOR", "COLUMNS", "LINES"):
        environment.pop(name, None)
    command = [sys.executable, "-m", "lndrl", "dashboard", "--connect", endpoint]
    process = subprocess.Popen(
        [*command, "--theme", "light"],
        env=environment,
        stdin=inside,
        stdout=inside,
        stderr=inside,
        start_new_session=True,
    )
    try:
        yield process, terminal
    finally:
        end(process)
        os.close(terminal)
        os.close(inside)


def _pictures(
    process: subprocess.Popen[bytes], terminal: int, seconds: float, least: int | None = None
) -> int:
    """Pictures drawn within ``seconds``; with ``least``, returns once there are so many."""
    deadline, drawn = time.monotonic() + seconds, 0
    while (left := deadline - time.monotonic()) > 0:
        if process.poll() is not None:
            raise UserError(f"bench dashboard: the viewer ended ({process.returncode})")
        if select.select([terminal], [], [], min(left, 0.2))[0]:
            drawn += os.read(terminal, 2**18).count(_HOME)
        if least is not None and drawn >= least:
            return drawn
    if least is not None:
        raise UserError(f"bench dashboard: nothing was drawn within {seconds:g} s")
    return drawn
