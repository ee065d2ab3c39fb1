"""A program in a pseudo-terminal, and the screen that a user of it would see."""

from __future__ import annotations

import codecs
import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.cells import cell_len

ROOT = Path(__file__).resolve().parents[4]
PATIENCE = 120.0  # s; starting a program on a busy machine takes long

# Makes standard input the terminal of this process and becomes the program that follows.
IN_TERMINAL = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""
_TOKEN = re.compile(
    r"\x1b\[(?P<parameters>[0-9;?]*)(?P<final>[A-Za-z])|\x1b\](?P<string>[^\x1b\x07]*)(?:\x07|\x1b\\)"
    r"|(?P<plain>[^\x1b])",
    re.DOTALL,
)


class Screen:
    """What the sequences that rich writes leave on a screen of ``width`` x ``height`` cells.

    Raises AssertionError for a sequence that it does not know, and for writing past the right or
    the lower edge, which would wrap or scroll.
    """

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.rows = [[" "] * width for _ in range(height)]
        self.x = self.y = 0
        self.alternate = False
        self.cursor = True
        self.styles: set[str] = set()
        self._rest = ""

    def feed(self, text: str) -> None:
        self._rest += text
        while self._rest and (token := _TOKEN.match(self._rest)):
            self._rest = self._rest[token.end() :]
            if token["plain"] is not None:
                self._write(token["plain"])
            elif token["final"] is not None:
                self._control(token["parameters"], token["final"])

    def _write(self, character: str) -> None:
        if character == "\r":
            self.x = 0
        elif character == "\n":
            self.y += 1
            assert self.y < self.height or not self.alternate, "the picture is too high"
            self.y = min(self.y, self.height - 1)
        elif self.alternate:
            cells = cell_len(character)
            assert self.x + cells <= self.width, f"row {self.y} is too wide: {self.row(self.y)!r}"
            if cells:
                self.rows[self.y][self.x : self.x + cells] = [character, *[""] * (cells - 1)]
            self.x += cells

    def _control(self, parameters: str, final: str) -> None:
        if final == "m":
            self.styles.add(parameters)
        elif final in "hl":
            if parameters == "?1049":
                self.alternate = final == "h"
                self.x = self.y = 0
            elif parameters == "?25":
                self.cursor = final == "h"
        elif final == "H":
            assert parameters in ("", "1;1"), parameters
            self.x = self.y = 0
        else:
            assert final in "JKAc", f"unknown sequence {parameters}{final}"

    def row(self, y: int) -> str:
        return "".join(self.rows[y]).rstrip()

    @property
    def text(self) -> str:
        return "\n".join(self.row(y) for y in range(self.height))


class Program:
    """A Python program in a terminal of its own, of ``size`` (columns, rows)."""

    def __init__(self, arguments: list[str], size: tuple[int, int], **environment: str) -> None:
        self.screen = Screen(*size)
        self.descriptor, inside = pty.openpty()
        fcntl.ioctl(inside, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))
        self.before = termios.tcgetattr(inside)
        kept = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "COLORFGBG")}
        kept |= {"TERM": "xterm-256color", "COLUMNS": "", "LINES": "", "PYTHONPATH": str(ROOT)}
        self.process = subprocess.Popen(
            [sys.executable, "-c", IN_TERMINAL, *arguments],
            env=kept | environment,
            stdin=inside,
            stdout=inside,
            stderr=inside,
            start_new_session=True,
        )
        self.inside = inside
        self.raw = ""
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")

    def read(self) -> None:
        while select.select([self.descriptor], [], [], 0.02)[0]:
            try:
                text = self._decoder.decode(os.read(self.descriptor, 65536))
            except OSError:
                return
            self.raw += text
            self.screen.feed(text)

    def type(self, keys: str) -> None:
        os.write(self.descriptor, keys.encode())

    def until(self, condition: Callable[[str], Any]) -> str:
        """Read until the screen's text meets ``condition``; returns the text."""
        deadline = time.monotonic() + PATIENCE
        while True:
            self.read()
            if condition(self.screen.text):
                return self.screen.text
            assert self.process.poll() is None, self.raw[-2000:]
            assert time.monotonic() < deadline, self.screen.text

    def press(self, keys: str, *expected: str) -> str:
        """Type ``keys`` and wait until the screen shows all that is ``expected``."""
        self.type(keys)
        return self.until(lambda text: all(words in text for words in expected))

    def end(self, number: int | None = None) -> int:
        """The exit code after a signal, or by itself; reads what is still written."""
        if number is not None:
            self.process.send_signal(number)
        deadline = time.monotonic() + PATIENCE
        while self.process.poll() is None:
            self.read()
            assert time.monotonic() < deadline
        self.read()
        return self.process.returncode

    def restored(self) -> bool:
        """Whether the terminal is as it was: its mode, its main screen, its cursor."""
        mode = termios.tcgetattr(self.inside)
        return mode == self.before and not self.screen.alternate and self.screen.cursor

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()
        os.close(self.descriptor)
        os.close(self.inside)
