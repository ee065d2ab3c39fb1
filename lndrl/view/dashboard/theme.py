"""Colours for dark and for light terminals, and how to find out which one it is."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache

from rich.text import Span, Text

from lndrl.view.palette import BLUE, GREEN, ORANGE, PINK, SKY, SLATE, VERMILLION

THEMES = ("dark", "light", "auto")
ANSWERS_WITHIN = 0.3
"""s that a terminal has to say what its background is."""

ON_LIGHT = {
    GREEN: "#00704F",
    VERMILLION: "#B04A00",
    BLUE: "#00639B",
    ORANGE: "#8A5C00",
    PINK: "#9C4577",
    SKY: "#0F6EA8",
    SLATE: "#566173",
}
"""Each colour of the palette on paper: the same hue, and dark enough to be read there (contrast
of at least 4.5, as WCAG 2 asks for text)."""

_ASK_BACKGROUND = "\x1b]11;?\x1b\\\x1b[c"  # OSC 11, and a question that every terminal answers
ATTRIBUTES = re.compile(r"\x1b\[\?[0-9;]*c")
"""The answer to that second question, after which no answer to the first will come."""
_BACKGROUND = re.compile(r"\x1b\]11;rgba?:([0-9a-fA-F]+)/([0-9a-fA-F]+)/([0-9a-fA-F]+)")


def recoloured(lines: Iterable[Text], theme: str) -> list[Text]:
    """``lines`` in the colours of ``theme``, dark or light."""
    lines = list(lines)
    if theme != "light":
        return lines
    for line in lines:
        line.spans = [Span(start, end, _on_light(str(style))) for start, end, style in line.spans]
        line.style = _on_light(str(line.style))
    return lines


@lru_cache(maxsize=256)
def _on_light(style: str) -> str:
    return " ".join(ON_LIGHT.get(word, word) for word in style.split())


def chosen(
    theme: str,
    ask: Callable[[str], str] | None = None,
    environment: Mapping[str, str] = os.environ,
) -> str:
    """dark or light, for one of THEMES.

    ``auto`` asks: COLORFGBG, which some terminals set, then the terminal itself through ``ask``,
    which sends it a question and returns what it answers; dark where neither says anything.
    """
    if theme != "auto":
        return theme
    background = environment.get("COLORFGBG", "").rpartition(";")[2]
    if background.isdecimal():
        # The sixteen colours of terminals: 7 and 9 to 15 are the light ones.
        return "light" if int(background) in (7, *range(9, 16)) else "dark"
    found = _BACKGROUND.search(ask(_ASK_BACKGROUND)) if ask is not None else None
    if found is None:
        return "dark"
    red, green, blue = (int(part, 16) / (16 ** len(part) - 1) for part in found.groups())
    return "light" if 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.5 else "dark"
