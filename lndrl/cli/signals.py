"""Ctrl-C for services: the first asks for an orderly end, the second ends at once."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

from lndrl.machine.signals import STOP_SIGNALS, stop_handler


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


class LastResort:
    """Ends the process so many ``seconds`` after ``arm``, unless ``disarm`` comes before."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._armed, self._over = threading.Event(), threading.Event()
        self._code = 0
        threading.Thread(target=self._watch, name="lndrl-last-resort", daemon=True).start()

    def arm(self, code: int = 0) -> None:
        """From now on it counts; ``code`` is what the process exits with. Only the first counts."""
        if not self._armed.is_set():
            self._code = code
            self._armed.set()

    def disarm(self) -> None:
        """The process has ended, or goes on, in its own way."""
        self._over.set()
        self._armed.set()

    def _watch(self) -> None:
        self._armed.wait()
        if not self._over.wait(self._seconds):
            # Not by print: whoever hangs may hold its lock.
            words = f"something hangs: ended at once, {self._seconds:g} s after it should have\n"
            with suppress(OSError):
                os.write(2, words.encode())
            os._exit(self._code)


@contextmanager
def last_resort(seconds: float) -> Iterator[LastResort]:
    """End the process ``seconds`` after a stop signal, if it is still in here.

    Holds even while the main thread waits inside a library and no handler of ours is called. Must
    be called on the main thread.
    """
    resort = LastResort(seconds)
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    before = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)

    def listen() -> None:
        with suppress(OSError):
            while heard := os.read(reader, 1):
                ignored = signal.getsignal(heard[0]) == signal.SIG_IGN
                if heard[0] in STOP_SIGNALS and not ignored:
                    resort.arm(128 + heard[0])
        os.close(reader)

    threading.Thread(target=listen, name="lndrl-signals", daemon=True).start()
    try:
        yield resort
    finally:
        signal.set_wakeup_fd(before)
        os.close(writer)  # which ends the thread
        resort.disarm()


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
    # A handler may be called while the same file is being written to: a RuntimeError.
    with suppress(OSError, ValueError, RuntimeError):
        print(line, file=file or sys.stderr, flush=True)
