"""The dashboard over time: a full-screen view on a terminal, lines elsewhere, or JSON."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from typing import Any

from rich.console import Console, Group

from lndrl.view.dashboard.board import Board
from lndrl.view.dashboard.feed import Feed, News, plain_json
from lndrl.view.dashboard.keys import key_presses
from lndrl.view.dashboard.screen import draw, plain_line
from lndrl.view.dashboard.theme import chosen, recoloured
from lndrl.view.dashboard.verdict import STALE_AFTER, headline
from lndrl.view.dashboard.view import View

REDRAW_EVERY = 0.25
LINE_EVERY = 30.0
"""s after which a line is printed even if nothing was learned."""


def show_live(feeds: Sequence[Feed], console: Console, theme: str = "auto") -> None:
    """Redraw until q is pressed; raises KeyboardInterrupt on Ctrl-C, the terminal restored."""
    with key_presses() as keys:
        board = Board(
            console,
            keys,
            theme,
            requests=[feed.request for feed in feeds],
            watches=[feed.watch for feed in feeds],
        )
        with board:
            while board.turn([feed.newest for feed in feeds], REDRAW_EVERY):
                pass


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


def show_once(news: News, console: Console, theme: str = "dark") -> None:
    """One picture of the present; plain characters and one line where there is no terminal."""
    if console.is_terminal and not console.is_dumb_terminal:
        lines = draw(news.status, news.history, console.width, None, 0.0, View()).lines
        console.print(Group(*recoloured(lines, chosen(theme))), end="")
    else:
        console.file.write(plain_line(news.status) + "\n")


__all__ = [
    "STALE_AFTER",
    "json_line",
    "show_json",
    "show_lines",
    "show_live",
    "show_once",
]
