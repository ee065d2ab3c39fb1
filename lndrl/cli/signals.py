"""Ctrl-C for services: the first asks for an orderly end, the second ends at once."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

from lndrl.machine.signals import stop_handler


class Stop(threading.Event):
    """An event that remembers which signal set it."""

    signal_number: int | None = None

    @property
    def exit_code(self) -> int:
        """0, or 128 + the signal's number as shells have it."""
        return 0 if self.signal_number is None else 128 + self.signal_number


@contextmanager
def stop_on_signals(promise: str) -> Iterator[Stop]:
    """A Stop that SIGINT, SIGTERM and SIGHUP set; a second signal raises KeyboardInterrupt.

    A closed terminal is told twice, by the shell and by the system, and often followed by SIGTERM:
    SIGHUP does not count, neither as the first nor as the second. Where it is ignored (nohup), it
    stays ignored. ``promise`` tells the user what the orderly end does. Must be called on the main
    thread.
    """
    stop = Stop()
    impatient = False

    def handle(number: int, frame: object) -> None:
        nonlocal impatient
        if number != signal.SIGHUP:
            if impatient:
                raise KeyboardInterrupt
            impatient = True
        if stop.is_set():
            return
        stop.signal_number = number
        stop.set()
        say(f"\nstopping: {promise}; Ctrl-C again stops at once")

    with stop_handler(handle):
        yield stop


@contextmanager
def telling(words: Callable[[], str]) -> Iterator[None]:
    """Say in one line, when interrupted in here, what is left and how to go on."""
    try:
        yield
    except KeyboardInterrupt:
        say(f"stopped: {words()}")
        raise


def say(line: str, file: TextIO | None = None) -> None:
    """A line on stderr, or on ``file``, that costs nothing where nobody can read it any more."""
    with suppress(OSError, ValueError):
        print(line, file=file or sys.stderr, flush=True)
