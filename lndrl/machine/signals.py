"""Signals that ask to stop: which there are, and how a child starts without losing one."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from types import FrameType

Handler = Callable[[int, FrameType | None], object]

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, ``kill``, and a terminal that was closed."""

_TERMINALS = {number for number in (1, 2) if os.isatty(number)}


@contextmanager
def stop_handler(handler: Handler) -> Iterator[None]:
    """Let ``handler`` hear the stop signals; the handlers before it come back. Main thread only.

    SIGHUP stays ignored where it is ignored already: that is what nohup is for. SIGINT does not:
    shells ignore it for what they start in the background, and others send it on purpose.
    """

    def handle(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGHUP:
            leave_terminal()
        handler(number, frame)

    heard = [
        number
        for number in STOP_SIGNALS
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN
    ]
    before = {number: signal.signal(number, handle) for number in heard}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


def leave_terminal() -> None:
    """Let what is printed go nowhere where it went to a terminal that is gone.

    Every further line would be an error, and cost the checkpoint that is to be written.
    """
    for number in _TERMINALS:
        if not os.isatty(number):
            with suppress(OSError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, number)
                os.close(nowhere)


@contextmanager
def starting_child() -> Iterator[None]:
    """Stop signals that come in here wait until the end of it, however they are handled.

    A child that is started here inherits a mask that keeps them from it; see ``unblock``.
    """
    resource_tracker.ensure_running()  # it unblocks signals itself when it has to start
    came: list[int] = []
    handlers = {}
    # The mask holds for this thread alone, and Python lets the main thread handle what another
    # one has received. Only the main thread may change handlers, and only it is interrupted.
    if threading.current_thread() is threading.main_thread():
        present = {number: signal.getsignal(number) for number in STOP_SIGNALS}
        handlers = {number: old for number, old in present.items() if callable(old)}
        for number in handlers:
            signal.signal(number, lambda number, frame: came.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for received in came:
            signal.raise_signal(received)


def unblock() -> None:
    """Let stop signals reach this process, a child that has its handlers now."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)
