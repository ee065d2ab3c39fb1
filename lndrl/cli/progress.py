"""One line on standard error that says how far something is."""

from __future__ import annotations

import sys
import time

from rich.console import Console
from rich.live import Live
from rich.text import Text

LINE_EVERY = 10.0
"""s between lines where there is no terminal."""


class Line:
    """A line that changes on a terminal; elsewhere one every few seconds."""

    def __init__(self) -> None:
        self._console = Console(file=sys.stderr, highlight=False)
        drawn = self._console.is_terminal and not self._console.is_dumb_terminal
        self._live = Live(console=self._console, transient=True) if drawn else None
        self._last = -LINE_EVERY

    def __enter__(self) -> Line:
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def show(self, words: str) -> None:
        """The state of things."""
        if self._live:
            self._live.update(Text(words, no_wrap=True, overflow="ellipsis"))
        elif time.monotonic() - self._last >= LINE_EVERY:
            self._last = time.monotonic()
            self._console.print(Text(f"{time.strftime('%H:%M:%S')} {words}"), soft_wrap=True)
