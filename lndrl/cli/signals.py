"""Ctrl-C for services: the first asks for an orderly end, the second ends at once."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stop(threading.Event):
    """An event that remembers which signal set it."""

    signal_number: int | None = None

    @property
    def exit_code(self) -> int:
        """0, or 128 + the signal's number as shells have it."""
        return 0 if self.signal_number is None else 128 + self.signal_number


@contextmanager
def stop_on_signals(promise: str) -> Iterator[Stop]:
    """A Stop that SIGINT and SIGTERM set; a second signal raises KeyboardInterrupt.

    ``promise`` tells the user what the orderly end does. Must be called on the main thread.
    """
    stop = Stop()

    def handle(number: int, frame: object) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.signal_number = number
        stop.set()
        print(f"\nstopping: {promise}; Ctrl-C again stops at once", file=sys.stderr)

    previous = {number: signal.signal(number, handle) for number in _SIGNALS}
    try:
        yield stop
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
