"""Words that fit: titles in lines and legends in columns that a figure has the width for."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from functools import cache, partial
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.legend import Legend
from matplotlib.textpath import TextPath

_POINTS = 72.0  # per inch
_HINTED = 1.06  # letters are moved to whole pixels, which widens small ones


@cache
def text_width(text: str, size: float, weight: str = "normal") -> float:
    """Inches that one line of ``text`` takes in the default font, ``size`` points high."""
    if not text.strip():
        return 0.0
    # Spaces at the ends have no outline; a bar on either side has.
    font = FontProperties(weight=weight)
    bars = TextPath((0, 0), "||", size=size, prop=font).get_extents().width
    line = TextPath((0, 0), f"|{text}|", size=size, prop=font, usetex=False)
    return float(line.get_extents().width - bars) * _HINTED / _POINTS


def wrapped(text: str, size: float, width: float) -> str:
    """``text`` in lines of at most ``width`` inches: broken between words, else within them."""
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if text_width(longer, size) <= width:
            lines[-1] = longer
            continue
        if lines[-1]:
            lines.append("")
        while text_width(word, size) > width and len(word) > 1:
            fits = _most(len(word) - 1, partial(_is_within, word, size, width))
            lines[-1], word = word[:fits], word[fits:]
            lines.append("")
        lines[-1] = word
    return "\n".join(line.rstrip() for line in lines)


def shortened(text: str, size: float, width: float, weight: str = "normal") -> str:
    """``text``, its middle replaced by an ellipsis where it is wider than ``width`` inches."""

    def short(kept: int) -> str:
        return f"{text[: kept - kept // 2]}…{text[len(text) - kept // 2 :]}"

    if text_width(text, size, weight) <= width or len(text) <= 2:
        return text
    most = len(text) - 1
    return short(max(2, _most(most, lambda n: text_width(short(n), size, weight) <= width)))


def _is_within(text: str, size: float, width: float, length: int) -> bool:
    return text_width(text[:length], size) <= width


def _most(most: int, fits: Callable[[int], bool]) -> int:
    """The largest number up to ``most`` that ``fits``, at least 1; what is smaller fits as well.

    Halving: outlines take milliseconds, and a name may be long.
    """
    return max(1, bisect_left(range(1, most + 1), True, key=lambda n: not fits(n)))


def add_legend(figure: Figure, handles: list[Any], columns: int, **style: Any) -> float:
    """A legend at the lower edge in up to ``columns`` columns, as many as fit into the figure.

    Returns its height in inches.
    """
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    while True:
        legend: Legend = figure.legend(
            handles=handles, loc="lower center", ncols=columns, frameon=False, **style
        )
        box = legend.get_window_extent(canvas.get_renderer())
        if box.width <= figure.get_figwidth() * figure.dpi or columns == 1:
            return float(box.height / figure.dpi)
        legend.remove()
        columns -= 1
