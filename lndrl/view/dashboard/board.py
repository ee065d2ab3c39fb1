"""The live picture of a run and what keys do to it, one turn after another."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from rich.console import Console, Group
from rich.live import Live

from lndrl.view.dashboard.feed import News
from lndrl.view.dashboard.keys import Keys
from lndrl.view.dashboard.screen import Picture, draw
from lndrl.view.dashboard.theme import ANSWERS_WITHIN, ATTRIBUTES, chosen, recoloured
from lndrl.view.dashboard.view import ASK_AGAIN_WITHIN, PANELS, Extent, View, press
from lndrl.view.dashboard.zoom import bar
from lndrl.view.text import duration, printable

SAID_FOR = 15.0
"""s for which the last line shows what came of a request."""


class Board:
    """Draws on the whole terminal between ``with`` and its end.

    ``leaving`` says beside the help how to leave; ``leaves``: whether q does.
    ``request`` asks the learner for something, may take seconds, and says what comes of it.
    """

    def __init__(
        self,
        console: Console,
        keys: Keys,
        theme: str = "auto",
        leaving: str = "q leaves",
        leaves: bool = True,
        request: Callable[[str], str] | None = None,
    ) -> None:
        self._console, self._keys = console, keys
        self._theme = chosen(theme, self._ask)
        self._leaving, self._leaves = leaving, leaves
        self._live = Live(console=console, screen=True, auto_refresh=False)
        self._view, self._extent = View(), Extent()
        self._held: tuple[News, float] | None = None
        self._drawn: tuple[Any, ...] = ()
        self._request = request
        self._said: tuple[str, float] = ("", 0.0)  # and until when, monotonic s

    def __enter__(self) -> Board:
        self._live.__enter__()
        return self

    def __exit__(self, *details: object) -> None:
        with suppress(OSError):  # of a terminal that is gone
            self._live.__exit__(None, None, None)

    def turn(self, news: News, wait: float) -> bool:
        """Draw what is new, then heed the keys of the next ``wait`` s; False once q is pressed."""
        self._refresh(news)
        pressed = self._keys.pressed(wait)
        while pressed:
            panels = [p for p in PANELS if p != "validation" or news.status.validation is not None]
            view, asked = press(self._view, pressed, self._extent, panels, time.monotonic())
            if view.paused != self._view.paused:
                self._held = (news, news.age) if view.paused else None
            self._view = view
            if asked == "leave" and self._leaves:
                return False
            if asked in ("checkpoint", "stop"):
                self._ask_learner(asked)
            pressed = self._keys.pressed(0.0)
        self._refresh(news)
        return True

    def _refresh(self, news: News) -> None:
        """Draw anew for news, another size, another view or the next second of age only.

        That spares the CPU that the training on this machine could use.
        """
        shown, age = self._held or (news, news.age)
        words = self._words(news)
        size = self._console.size
        present = (id(shown), size, round(age), self._view, words)
        if present == self._drawn:
            return
        picture = self._picture(shown, age, *size, words)
        self._extent = picture.extent
        with suppress(OSError):
            self._live.update(Group(*picture.lines), refresh=True)
        self._drawn = present

    def _picture(self, news: News, age: float, width: int, height: int, words: str) -> Picture:
        picture = draw(news.status, news.history, width, max(height - 1, 1), age, self._view)
        lines = [*picture.lines, bar(words, width, f"? help  {self._leaving}")]
        return Picture(recoloured(lines[-height:], self._theme), picture.extent)

    def _words(self, news: News) -> str:
        """What the last line says of the state of things, most urgent first."""
        view = self._view
        if view.typing:
            return f"/{printable(view.needle)}▏ Enter keeps it, Esc: all actors"
        now, (said, until) = time.monotonic(), self._said
        if view.stop_asked is not None and now - view.stop_asked <= ASK_AGAIN_WITHIN:
            return f"S again within {ASK_AGAIN_WITHIN:.0f} s stops the run for everybody"
        if said and now < until:
            return said
        parts = []
        if self._held is not None:
            behind = max(news.status.time - self._held[0].status.time, 0.0)
            parts.append(f"HELD, {duration(behind)} behind: space goes on")
        if view.focus:
            parts.append(f"▸ {view.focus}: Enter {'back' if view.zoomed else 'whole screen'}")
        if view.needle:
            parts.append(f"/{printable(view.needle)}")
        return " · ".join(parts)

    def _ask_learner(self, action: str) -> None:
        """Ask for ``action`` in a thread: the picture and its keys never wait for the network."""
        request = self._request
        if request is None:
            self._said = ("nothing can be asked of this run", time.monotonic() + SAID_FOR)
            return
        self._said = (f"asking for a {action} …", time.monotonic() + SAID_FOR)

        def work() -> None:
            words = " ".join(printable(request(action)).split())
            self._said = (words, time.monotonic() + SAID_FOR)

        threading.Thread(target=work, name="dashboard-request", daemon=True).start()

    def _ask(self, question: str) -> str:
        """What the terminal answers to ``question``; see ``theme.chosen``."""
        if not self._keys.listening:
            return ""
        self._console.file.write(question)
        self._console.file.flush()
        return self._keys.answer(ANSWERS_WITHIN, ATTRIBUTES)
