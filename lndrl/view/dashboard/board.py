"""The live picture of a run and what keys do to it, one turn after another."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from lndrl.view.dashboard.actors import first_here, matching, ordered
from lndrl.view.dashboard.feed import News
from lndrl.view.dashboard.keys import Keys
from lndrl.view.dashboard.panels import Panel
from lndrl.view.dashboard.screen import Picture, abreast, alone, draw
from lndrl.view.dashboard.theme import ANSWERS_WITHIN, ATTRIBUTES, chosen, recoloured
from lndrl.view.dashboard.view import ASK_AGAIN_WITHIN, PANELS, Extent, View, press
from lndrl.view.dashboard.worlds import Onlooker, Watch, empty, world_panel
from lndrl.view.dashboard.zoom import bar
from lndrl.view.text import duration, printable

LEAST_BESIDE = 60
"""Columns that each of several runs needs beside the others."""
LOOK_EVERY = 0.05
"""s between two looks for a live world's next frame."""
SAID_FOR = 15.0
"""s for which the last line shows what came of a request."""


class Board:
    """Draws on the whole terminal between ``with`` and its end.

    ``leaving`` says beside the help how to leave; ``leaves``: whether q does.
    ``requests``, one for each run, ask its learner for something, may take seconds, and say what
    comes of it. ``watches``, likewise, have one of its actors show a world.
    """

    def __init__(
        self,
        console: Console,
        keys: Keys,
        theme: str = "auto",
        leaving: str = "q leaves",
        leaves: bool = True,
        requests: Sequence[Callable[[str], str]] = (),
        watches: Sequence[Watch] = (),
    ) -> None:
        self._console, self._keys = console, keys
        self._theme = chosen(theme, self._ask)
        self._leaving, self._leaves = leaving, leaves
        self._live = Live(console=console, screen=True, auto_refresh=False)
        self._view, self._extent = View(), Extent()
        self._held: list[tuple[News, float]] | None = None
        self._drawn: tuple[Any, ...] = ()
        self._requests = requests
        self._watches = watches
        self._onlooker: Onlooker | None = None
        self._said: tuple[str, float] = ("", 0.0)  # and until when, monotonic s

    def __enter__(self) -> Board:
        self._live.__enter__()
        return self

    def __exit__(self, *details: object) -> None:
        self._look_away()
        with suppress(OSError):  # of a terminal that is gone
            self._live.__exit__(None, None, None)

    def turn(self, runs: Sequence[News], wait: float) -> bool:
        """Draw what is new, then heed the keys of the next ``wait`` s; False once q is pressed.

        A live world is drawn as often as it comes, whatever ``wait`` is.
        """
        until = time.monotonic() + wait
        self._refresh(runs)
        while self._onlooker is not None and (left := until - time.monotonic()) > LOOK_EVERY:
            if not self._heed(runs, min(LOOK_EVERY, left)):
                return False
            self._refresh(runs)
        going_on = self._heed(runs, max(until - time.monotonic(), 0.0))
        self._refresh(runs)
        return going_on

    def _heed(self, runs: Sequence[News], wait: float) -> bool:
        """Do what the keys of the next ``wait`` s say; False once q is pressed."""
        pressed = self._keys.pressed(wait)
        while pressed:
            news = runs[self._view.run]
            panels = [p for p in PANELS if p != "validation" or news.status.validation is not None]
            view, asked = press(self._view, pressed, self._extent, panels, time.monotonic())
            if view.paused != self._view.paused:
                self._held = [(each, each.age) for each in runs] if view.paused else None
            self._view = view
            if asked == "leave" and self._leaves:
                return False
            if asked in ("checkpoint", "stop"):
                self._ask_learner(asked)
            if asked in ("watch", "next", "previous"):
                self._look_at(runs[view.run], asked)
            elif not view.watching:
                self._look_away()
            pressed = self._keys.pressed(0.0)
        return True

    def _look_at(self, news: News, which: str) -> None:
        """Watch the first actor of the table as it is sorted, filtered and scrolled, or another."""
        view = self._view
        actors = ordered(matching(news.status.actors, view.needle), view.order)
        names = [actor.id for actor in actors if actor.state != "gone"]
        place = 0
        if which == "watch":
            first = first_here(actors[view.scroll :])
            place = names.index(first.id) if first is not None else 0
        elif self._onlooker is not None and self._onlooker.actor_id in names:
            step = 1 if which == "next" else -1
            place = (names.index(self._onlooker.actor_id) + step) % len(names)
        self._look_away()
        if names and view.run < len(self._watches):
            self._onlooker = Onlooker(names[place], self._watches[view.run])

    def _look_away(self) -> None:
        if self._onlooker is not None:
            self._onlooker.close()
            self._onlooker = None

    def _refresh(self, runs: Sequence[News]) -> None:
        """Draw anew for news, another size, another view or the next second of age only.

        That spares the CPU that the training on this machine could use.
        """
        shown = self._held or [(each, each.age) for each in runs]
        words = self._words(runs[self._view.run], len(runs))
        size = self._console.size
        ages = [(id(each), round(age)) for each, age in shown]
        if self._view.watching and self._onlooker is None and self._watches:
            self._look_at(runs[self._view.run], "watch")  # who has joined meanwhile
        seen = self._onlooker
        if seen is not None and not self._view.paused:
            seen.look()
        world = None if seen is None else (id(seen.snapshot), seen.words())
        present = (ages, size, self._view, words, world)
        if present == self._drawn:
            return
        picture = self._picture(shown, *size, words)
        self._extent = picture.extent
        with suppress(OSError):
            self._live.update(Group(*picture.lines), refresh=True)
        self._drawn = present

    def _picture(
        self, shown: Sequence[tuple[News, float]], width: int, height: int, words: str
    ) -> Picture:
        """Runs side by side where each has the room, else the one that is chosen; a live world has
        all of the screen.
        """
        count, chosen_run = len(shown), self._view.run
        rows = max(height - 1, 1)
        right = f"? help  {self._leaving}"
        if self._view.watching and not self._view.helping:
            lines = self._world(*shown[chosen_run], width, rows)
            extent = replace(self._extent, runs=count)
            lines.append(bar(words, width, right))
            return Picture(recoloured(lines[-height:], self._theme), extent)
        each = (width - (count - 1)) // count
        if count > 1 and each < LEAST_BESIDE:
            shown, each, chosen_run = [shown[chosen_run]], width, 0
        pictures = [draw(n.status, n.history, each, rows, age, self._view) for n, age in shown]
        lines = abreast([picture.lines for picture in pictures], each)
        lines.append(bar(words, width, right))
        extent = replace(pictures[chosen_run].extent, runs=count)
        return Picture(recoloured(lines[-height:], self._theme), extent)

    def _world(self, news: News, age: float, width: int, rows: int) -> list[Text]:
        """The live world that is watched, or why there is none, in ``rows`` lines."""

        def panel(inside: int, room: int) -> Panel:
            if self._onlooker is not None:
                colours = not self._console.no_color
                return world_panel(self._onlooker, inside, room, colours)
            if not self._watches:
                return empty("the worlds of this run cannot be watched from here", inside, room)
            return empty("no actor is at work", inside, room)

        return alone(news.status, width, rows, age, panel)

    def _words(self, news: News, runs: int) -> str:
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
        if runs > 1:
            name = printable(news.status.run_name or news.status.run_id)
            parts.append(f"run {view.run + 1} of {runs}: {name}")
        if self._held is not None:
            behind = max(news.status.time - self._held[view.run][0].status.time, 0.0)
            parts.append(f"HELD, {duration(behind)} behind: space goes on")
        if view.watching:
            parts.append("arrows: the next actor's, l: back")
        elif view.focus:
            parts.append(f"▸ {view.focus}: Enter {'back' if view.zoomed else 'whole screen'}")
        if view.needle:
            parts.append(f"/{printable(view.needle)}")
        return " · ".join(parts)

    def _ask_learner(self, action: str) -> None:
        """Ask for ``action`` in a thread: the picture and its keys never wait for the network."""
        if self._view.run >= len(self._requests):
            self._said = ("nothing can be asked of this run", time.monotonic() + SAID_FOR)
            return
        request = self._requests[self._view.run]
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
