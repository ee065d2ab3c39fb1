"""The screen of a live drive, drawn by a thread of its own: the robot must not wait for it."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import typer

if TYPE_CHECKING:
    from rich.console import Console

    from lndrl.robot.driving import DriveService, DriveView

    Show = Callable[[DriveView], None]

LINE_EVERY = 5.0
"""s between two lines where there is no terminal; a change of what stops it is told at once."""
_SWITCH = 0.001
"""s for which the drawing thread may keep the drive from working, where Python has it so."""


@contextmanager
def screen(head: str, service: DriveService, plain: bool) -> Iterator[Show]:
    """What to show views on: a screen where there is a terminal, else lines on stderr."""
    from rich.console import Console

    console = Console(highlight=False)
    if plain or not console.is_terminal or console.is_dumb_terminal:
        yield _lines()
        return
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH)
    drawer = _Drawer(console, head, service)
    try:
        yield drawer.show
    finally:
        drawer.close()
        sys.setswitchinterval(before)


class _Drawer:
    """Draws the newest view, whenever it is done with the one before."""

    def __init__(self, console: Console, head: str, service: DriveService) -> None:
        self._console, self._head, self._service = console, head, service
        self._colours = console.color_system is not None and not console.no_color
        self._newest: DriveView | None = None
        self._news, self._over = threading.Event(), False
        self._thread = threading.Thread(target=self._work, name="lndrl-screen", daemon=True)
        self._thread.start()

    def show(self, view: DriveView) -> None:
        """Draw ``view`` soon."""
        self._newest = view
        self._news.set()

    def close(self) -> None:
        """Draw the last one and leave it there."""
        self._over = True
        self._news.set()
        self._thread.join(2.0)

    def _work(self) -> None:
        from rich.live import Live

        from lndrl.view.robots.drive import drive_screen

        with Live(
            console=self._console, auto_refresh=False, screen=False, vertical_overflow="crop"
        ) as live:
            while not self._over:
                self._news.wait()
                self._news.clear()
                if (view := self._newest) is None:
                    continue
                recent = list(self._service.latencies)[-50:]
                usual = float(np.median(recent)) if recent else None
                width, height = self._console.size
                drawn = drive_screen(view, self._head, usual, width - 1, height - 1, self._colours)
                live.update(drawn, refresh=True)


def _lines() -> Show:
    """A line now and then, and whenever something else stops it."""
    from lndrl.view.robots.drive import drive_line

    last: tuple[float, tuple[str, ...]] = (-np.inf, ("",))

    def show(view: DriveView) -> None:
        nonlocal last
        labels = tuple(stop.reason.label for stop in view.stops)
        if labels != last[1] or view.time - last[0] >= LINE_EVERY:
            last = view.time, labels
            typer.echo(drive_line(view), err=True)

    return show
