"""Single key presses by name, from a terminal that gets its mode back however the program ends."""

from __future__ import annotations

import codecs
import os
import re
import select
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

NAMES = {
    "\t": "tab",
    "\r": "enter",
    "\n": "enter",
    "\x7f": "backspace",
    "\x08": "backspace",
    "\x1b[Z": "shift-tab",
    "\x1b[A": "up",
    "\x1b[B": "down",
    "\x1b[C": "right",
    "\x1b[D": "left",
    "\x1b[H": "home",
    "\x1b[F": "end",
    "\x1bOA": "up",
    "\x1bOB": "down",
    "\x1bOC": "right",
    "\x1bOD": "left",
    "\x1bOH": "home",
    "\x1bOF": "end",
    "\x1b[1~": "home",
    "\x1b[4~": "end",
    "\x1b[5~": "pageup",
    "\x1b[6~": "pagedown",
    "\x1b[7~": "home",
    "\x1b[8~": "end",
}
"""What terminals send for keys that are no characters, as xterm and its kin do; ``escape`` is an
ESC that nothing follows."""
FOLLOWS_WITHIN = 0.05
"""s in which the rest of a sequence follows its ESC, else it was the key."""

# Sequences as ECMA-48 has them: CSI with parameters, SS3, and strings (OSC, DCS and the like).
_SEQUENCE = re.compile(
    r"\x1b(?:\[[0-?]*[ -/]*[@-~]|O[ -~]|[\]P_^X][^\x07\x1b]*(?:\x07|\x1b\\)|[^\[OP\]_^X\x1b])"
)


class Keys:
    """Key presses of a terminal; none where ``stream`` is None."""

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream
        self._decoder = codecs.getincrementaldecoder("utf-8")("ignore")
        self._waiting = ""

    @property
    def listening(self) -> bool:
        """Whether there is a terminal that keys come from."""
        return self._stream is not None

    def pressed(self, wait: float) -> str:
        """The next key within ``wait`` s by its name, or nothing.

        A character is its own name. Sequences of keys without a name, and what a terminal answers
        to a question, are swallowed whole.
        """
        deadline = time.monotonic() + wait
        while True:
            while self._waiting:
                if key := self._take():
                    return key
            left = max(deadline - time.monotonic(), 0.0)
            if self._stream is None:
                time.sleep(left)
                return ""
            if not self._read(left):
                return ""

    def answer(self, wait: float, end: re.Pattern[str]) -> str:
        """What the terminal says within ``wait`` s up to ``end``, taken out of the keys."""
        deadline = time.monotonic() + wait
        while (found := end.search(self._waiting)) is None:
            if not self._read(max(deadline - time.monotonic(), 0.0)):
                return ""
        said, self._waiting = self._waiting[: found.end()], self._waiting[found.end() :]
        return said

    def _read(self, wait: float) -> bool:
        """Whether anything came within ``wait`` s."""
        if self._stream is None or not select.select([self._stream], [], [], wait)[0]:
            return False
        try:
            data = os.read(self._stream.fileno(), 1024)
        except OSError:
            data = b""
        if not data:  # the terminal has gone
            self._stream = None
        self._waiting += self._decoder.decode(data)
        return bool(data)

    def _take(self) -> str:
        """The first key of what has come; nothing where a sequence is not complete."""
        if self._waiting[0] != "\x1b":
            key, self._waiting = self._waiting[0], self._waiting[1:]
            return NAMES.get(key, key if key.isprintable() else "")
        found = _SEQUENCE.match(self._waiting)
        if found is None:
            if self._read(FOLLOWS_WITHIN):
                return ""
            # Nothing follows: it was the key, or half a sequence that is worth nothing.
            alone, self._waiting = self._waiting == "\x1b", ""
            return "escape" if alone else ""
        self._waiting = self._waiting[found.end() :]
        return NAMES.get(found.group(), "")


@contextmanager
def key_presses(stream: TextIO | None = None) -> Iterator[Keys]:
    """Keys of ``stream`` (stdin) without Enter and echo; the terminal always gets its mode back."""
    stream = stream or sys.stdin
    before = _mode(stream)
    if before is None:
        yield Keys(None)
        return
    import termios
    import tty

    try:
        # cbreak, not raw: Ctrl-C stays a signal and line ends stay line ends.
        tty.setcbreak(stream.fileno())
        yield Keys(stream)
    finally:
        with suppress(termios.error):  # the terminal may be gone
            # What was typed ahead was for the dashboard, not for the shell after it.
            termios.tcsetattr(stream.fileno(), termios.TCSAFLUSH, before)


def _mode(stream: TextIO) -> list[Any] | None:
    """The terminal's mode, None where ``stream`` is no terminal (or the system has no termios).

    None as well for a terminal whose keys go to another program: whoever is in the background
    would be stopped by touching its mode.
    """
    try:
        import termios
    except ImportError:
        return None
    try:
        mode = termios.tcgetattr(stream.fileno())
        with suppress(OSError):  # of a terminal that is not the one this process belongs to
            if os.tcgetpgrp(stream.fileno()) != os.getpgrp():
                return None
        return mode
    except (AttributeError, OSError, ValueError, termios.error):
        return None
