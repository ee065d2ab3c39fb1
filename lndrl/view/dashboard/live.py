"""The dashboard over time: a full-screen view on a terminal, lines elsewhere, or JSON."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from rich.console import Console
from rich.live import Live

from lndrl.view.dashboard.feed import Feed, News, plain_json
from lndrl.view.dashboard.screen import plain_line, render
from lndrl.view.dashboard.verdict import STALE_AFTER, headline

REDRAW_EVERY = 0.25
LINE_EVERY = 30.0
"""s after which a line is printed even if nothing was learned."""


class Keys:
    """Single key presses, where standard input is a terminal."""

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream

    def pressed(self, wait: float) -> str:
        """The next key within ``wait`` s, or nothing."""
        if self._stream is None:
            time.sleep(wait)
            return ""
        import os
        import select

        if not select.select([self._stream], [], [], wait)[0]:
            return ""
        data = os.read(self._stream.fileno(), 64)
        if not data:  # the terminal has gone
            self._stream = None
        return data.decode(errors="ignore")[:1]


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
            termios.tcsetattr(stream.fileno(), termios.TCSADRAIN, before)


def _mode(stream: TextIO) -> list[Any] | None:
    """The terminal's mode, None where ``stream`` is no terminal (or the system has no termios)."""
    try:
        import termios
    except ImportError:
        return None
    try:
        return termios.tcgetattr(stream.fileno())
    except (AttributeError, OSError, ValueError, termios.error):
        return None


def show_live(feed: Feed, console: Console) -> None:
    """Redraw until q is pressed; raises KeyboardInterrupt on Ctrl-C, the terminal restored."""
    with key_presses() as keys, Live(console=console, screen=True, auto_refresh=False) as live:
        drawn: tuple[Any, ...] = ()
        while True:
            news = feed.newest
            # Drawing anew only for news, another size or the next second of age spares the CPU
            # that the training on this machine could use.
            present = (id(news), console.size, round(news.age))
            if present != drawn:
                live.update(
                    render(news.status, news.history, *console.size, news.age, "q quits"),
                    refresh=True,
                )
                drawn = present
            if keys.pressed(REDRAW_EVERY) in ("q", "Q"):
                return


def show_lines(feed: Feed, write: Callable[[str], Any], pause: float = REDRAW_EVERY) -> None:
    """A line per learner update, change of verdict, or half a minute; ends when the run ends."""
    shown: tuple[Any, ...] = ()
    printed = -LINE_EVERY
    while True:
        news = feed.newest
        word = headline(news.status, news.age).word
        state = (news.status.run_id, news.status.updates, word)
        if state != shown or time.monotonic() - printed >= LINE_EVERY:
            write(plain_line(news.status, news.age))
            shown, printed = state, time.monotonic()
        if word == "done":
            return
        time.sleep(pause)


def show_json(feed: Feed, write: Callable[[str], Any], pause: float = REDRAW_EVERY) -> None:
    """A JSON object per answer, with the history rows that are new; ends when the run ends."""
    last: News | None = None
    since = -1.0
    while True:
        news = feed.newest
        if news is not last:
            write(json_line(news, since))
            last = news
            since = news.history[-1].time if news.history else since
        if headline(news.status).word == "done":
            return
        time.sleep(pause)


def json_line(news: News, since: float = -1.0) -> str:
    """The learner's answer as strict JSON on one line, history only after unix time ``since``."""
    rows = news.raw.get("history") or []
    new = [row for row, parsed in zip(rows, news.history, strict=True) if parsed.time > since]
    return json.dumps(plain_json({"snapshot": news.raw["snapshot"], "history": new}))


def show_once(news: News, console: Console) -> None:
    """One picture of the present; plain characters and one line where there is no terminal."""
    if console.is_terminal and not console.is_dumb_terminal:
        console.print(render(news.status, news.history, console.width), end="")
    else:
        console.file.write(plain_line(news.status) + "\n")


__all__ = [
    "STALE_AFTER",
    "json_line",
    "key_presses",
    "show_json",
    "show_lines",
    "show_live",
    "show_once",
]
