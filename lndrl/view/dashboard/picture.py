"""The dashboard as a picture in a file: SVG, drawn by rich, that asks nobody for a font."""

from __future__ import annotations

import io
import re
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console, Group
from rich.terminal_theme import DEFAULT_TERMINAL_THEME, SVG_EXPORT_THEME
from rich.text import Text

from lndrl.errors import UserError
from lndrl.view.dashboard.actors import first_here
from lndrl.view.dashboard.feed import News
from lndrl.view.dashboard.screen import abreast, alone, draw
from lndrl.view.dashboard.theme import recoloured
from lndrl.view.dashboard.view import View
from lndrl.view.dashboard.worlds import Onlooker, Watch, world_panel

SIZE = (120, 40)
"""Columns and rows where no terminal says otherwise."""
WORLD_WITHIN = 20.0
"""s that an actor has to show its world."""
_FONT = "ui-monospace, 'DejaVu Sans Mono', Menlo, Consolas, monospace"
_FACES = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)


def save_svg(lines: Sequence[Text], width: int, path: Path, theme: str, title: str) -> None:
    """Write ``lines`` of ``width`` cells as a window; raises OSError where that cannot be."""
    console = Console(
        record=True,
        width=width,
        file=io.StringIO(),
        force_terminal=True,
        color_system="truecolor",
        highlight=False,
        legacy_windows=False,
        no_color=False,
    )
    console.print(Group(*recoloured(lines, theme)))
    shades = DEFAULT_TERMINAL_THEME if theme == "light" else SVG_EXPORT_THEME
    drawn = _FACES.sub("", console.export_svg(title=title, theme=shades))
    drawn = drawn.replace("Fira Code, monospace", _FONT).replace("Fira Code", _FONT)
    path.write_text(drawn, encoding="utf-8")


def picture_lines(runs: Sequence[News], width: int, height: int) -> list[Text]:
    """The present of some runs, side by side."""
    each = (width - (len(runs) - 1)) // len(runs)
    pictures = [draw(n.status, n.history, each, height, n.age, View()).lines for n in runs]
    return abreast(pictures, each)


def world_lines(news: News, watch: Watch, width: int, height: int) -> list[Text]:
    """The live world of the first actor that is there; raises UserError where none comes."""
    actor = first_here(news.status.actors)
    if actor is None:
        raise UserError("no actor is at work, so there is no world to see")
    onlooker = Onlooker(actor.id, watch)
    try:
        deadline = time.monotonic() + WORLD_WITHIN
        while not (onlooker.look() and onlooker.snapshot and onlooker.snapshot.steps):
            if time.monotonic() > deadline:
                raise UserError(f"{actor.id} shows no world: {onlooker.words()}")
            time.sleep(0.02)
        return alone(
            news.status,
            width,
            height,
            news.age,
            lambda inside, rows: world_panel(onlooker, inside, rows),
        )
    finally:
        onlooker.close()
