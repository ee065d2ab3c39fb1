"""Ports for programs that are about to start, chosen so that nobody else takes them meanwhile."""

from __future__ import annotations

import os
import socket
from itertools import count
from pathlib import Path
from threading import Lock

LOWEST = 20_000
STRIDE = 97
"""Ports between the first choices of two processes that start one after the other."""

_GIVEN_BY_THE_SYSTEM = Path("/proc/sys/net/ipv4/ip_local_port_range")
_USUAL_FIRST = 32_768
_lock = Lock()
_turns = count()


def free_port(host: str = "127.0.0.1") -> int:
    """A TCP port of ``host`` that nobody listens on.

    A program needs seconds until it listens. So the port lies below those that the system gives to
    connections and to whoever asks for any port, and a process is given none twice in a row.
    Without room below them it is one of the system's. Raises OSError when ``host`` is not here.
    """
    room = _first_of_the_system() - LOWEST
    for _ in range(room):
        with _lock:
            turn = next(_turns)
        port = LOWEST + (os.getpid() * STRIDE + turn) % room
        try:
            return _bound(host, port)
        except OSError:
            continue
    return _bound(host, 0)


def _bound(host: str, port: int) -> int:
    """The port that could be bound, and is free again."""
    with socket.socket() as probe:
        probe.bind((host, port))
        return int(probe.getsockname()[1])


def _first_of_the_system() -> int:
    """The lowest port that the system gives out by itself."""
    try:
        return int(_GIVEN_BY_THE_SYSTEM.read_text("ascii").split()[0])
    except (OSError, ValueError, IndexError):
        return _USUAL_FIRST
