"""The live picture of a run and what keys do to it, one turn after another."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from rich.console import Console, Group
from rich.live import Live

from lndrl.view.dashboard.feed import News
from lndrl.view.dashboard.keys import Keys
from lndrl.view.dashboard.screen import Picture, draw
from lndrl.view.dashboard.theme import ANSWERS_WITHIN, ATTRIBUTES, chosen, recoloured
from lndrl.view.dashboard.view import PANELS, Extent, View, press
from lndrl.view.dashboard.zoom import bar
from lndrl.view.text import duration, printable


class Board:
    """Draws on the whole terminal between ``with`` and its end.

    ``leaving`` says beside the help how to leave; ``leaves``: whether q does.
    """

    def __init__(
        self,
        console: Console,
        keys: Keys,
        theme: str = "auto",
        leaving: str = "q leaves",
        leaves: bool = True,
    ) -> None:
        self._console, self._keys = console, keys
        self._theme = chosen(theme, self._ask)
        self._leaving, self._leaves = leaving, leaves
        self._live = Live(console=console, screen=True, auto_refresh=False)
        self._view, self._extent = View(), Extent()
        self._held: tuple[News, float] | None = None
        self._drawn: tuple[Any, ...] = ()

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
            view, asked = press(self._view, pressed, self._extent, panels)
            if view.paused != self._view.paused:
                self._held = (news, news.age) if view.paused else None
            self._view = view
            if asked == "leave" and self._leaves:
                return False
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
        parts = []
        if self._held is not None:
            behind = max(news.status.time - self._held[0].status.time, 0.0)
            parts.append(f"HELD, {duration(behind)} behind: space goes on")
        if view.focus:
            parts.append(f"▸ {view.focus}: Enter {'back' if view.zoomed else 'whole screen'}")
        if view.needle:
            parts.append(f"/{printable(view.needle)}")
        return " · ".join(parts)

    def _ask(self, question: str) -> str:
        """What the terminal answers to ``question``; see ``theme.chosen``."""
        if not self._keys.listening:
            return ""
        self._console.file.write(question)
        self._console.file.flush()
        return self._keys.answer(ANSWERS_WITHIN, ATTRIBUTES)
