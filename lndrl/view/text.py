"""Small pictures and numbers made of characters: sparklines, bars, durations, clipped words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rich.cells import cell_len
from rich.text import Text

SPARKS = "▁▂▃▄▅▆▇█"
BLOCKS = "█▓▒░▞▚"
"""Fillings of a stacked bar: distinct without colour too."""
MISSING = "–"


def finite(values: Sequence[float | None]) -> list[float]:
    """The values that are numbers."""
    return [v for v in values if v is not None and math.isfinite(v)]


def resample(values: Sequence[float | None], width: int) -> list[float | None]:
    """Means of ``width`` equal spans, newest at the end; shorter series are returned whole.

    A span without any number is None.
    """
    if len(values) <= width:
        return list(values)
    result: list[float | None] = []
    for i in range(width):
        span = finite(values[i * len(values) // width : max((i + 1) * len(values) // width, 1)])
        result.append(sum(span) / len(span) if span else None)
    return result


def sparkline(values: Sequence[float | None], width: int) -> str:
    """At most ``width`` characters that rise and fall like ``values``; gaps are blanks.

    The lowest value is drawn lowest and the highest highest; a constant series runs low.
    """
    if width <= 0:
        return ""
    points = resample(values, width)
    numbers = finite(points)
    if not numbers:
        return ""
    low, span = min(numbers), max(numbers) - min(numbers)
    top = len(SPARKS) - 1
    return "".join(
        " "
        if p is None or not math.isfinite(p)
        else SPARKS[round((p - low) / span * top) if span > 1e-12 else 0]
        for p in points
    )


def styled(words: str, style: str) -> Text:
    """``words`` in ``style``, ready to be continued in another one.

    Unlike ``Text(words, style=...)``, whose style would reach over all that is appended.
    """
    return Text(no_wrap=True).append(words, style=style)


def stacked_bar(shares: Sequence[tuple[float, str]], width: int, total: float = 1.0) -> Text:
    """A bar of ``width`` cells split by ``(share, colour)``; the rest up to ``total`` is dotted.

    Rounds the borders, not the parts, so that the parts always fill what they should.
    """
    bar = Text(no_wrap=True)
    reached, filled = 0.0, 0
    for i, (share, colour) in enumerate(shares):
        reached += max(share, 0.0)
        end = min(round(reached / total * width), width)
        if end > filled:
            bar.append(BLOCKS[i % len(BLOCKS)] * (end - filled), style=colour)
            filled = end
    bar.append("·" * (width - filled), style="dim")
    return bar


def progress_bar(share: float, width: int, colour: str) -> Text:
    """A thin line, full up to ``share``, in half-cell steps."""
    halves = max(0, min(round(share * width * 2), width * 2))
    bar = styled("━" * (halves // 2) + "╸" * (halves % 2), colour)
    bar.append("─" * (width - len(bar.plain)), style="dim")
    return bar


def duration(seconds: float | None) -> str:
    """Two largest units: ``48 s``, ``3 min 5 s``, ``2 h 10 min``, ``3 d 4 h``."""
    if seconds is None or not math.isfinite(seconds):
        return MISSING
    left = round(max(seconds, 0.0))
    for size, unit, below, small in ((86400, "d", 3600, "h"), (3600, "h", 60, "min")):
        if left >= size:
            rest = left % size // below
            return f"{left // size} {unit} {rest} {small}" if rest else f"{left // size} {unit}"
    if left >= 60:
        return (
            f"{left // 60} min {left % 60} s" if left < 600 and left % 60 else f"{left // 60} min"
        )
    return f"{left} s"


def percent(share: float | None, digits: int = 1) -> str:
    """``0.521`` as ``52.1 %``; nothing known as a dash."""
    if share is None or not math.isfinite(share):
        return MISSING
    return f"{100 * share:.{digits}f} %"


def number(value: float | None, digits: int = 3) -> str:
    """About ``digits`` significant digits without surprises; NaN and infinity are named."""
    if value is None:
        return MISSING
    if math.isnan(value):
        return "NaN"
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    size = abs(value)
    if size >= 10**digits or size == 0:
        return f"{value:,.0f}"
    if size < 1e-3:
        return f"{value:.1e}"
    return f"{value:.{max(digits - 1 - math.floor(math.log10(size)), 0)}f}"


def printable(words: str) -> str:
    """``words`` on one line without control characters, whoever sent them."""
    return "".join(c if c.isprintable() else " " for c in words)


def fit(line: Text, width: int) -> Text:
    """A copy of ``line`` that is exactly ``width`` cells wide: cut with an ellipsis or padded."""
    line = line.copy()
    line.no_wrap = True
    line.truncate(max(width, 0), overflow="ellipsis", pad=True)
    return line


def beside(left: Text, right: Text, width: int) -> Text:
    """``left`` and, flush right, ``right``; the left one yields when both do not fit."""
    room = width - right.cell_len
    if room < 2:
        return fit(left, width)
    return fit(left, room).append_text(right)


def wrap(words: str, width: int, limit: int) -> list[str]:
    """``words`` in at most ``limit`` lines of ``width`` cells, the last one cut if need be."""
    lines = [""]
    for word in printable(words).split():
        joined = f"{lines[-1]} {word}".strip()
        if cell_len(joined) <= width or not lines[-1]:
            lines[-1] = joined
        else:
            lines.append(word)
    if len(lines) > limit:
        lines = [*lines[: limit - 1], " ".join(lines[limit - 1 :])]
    return lines


def named_shares(shares: Mapping[str, float], order: Sequence[str]) -> list[tuple[str, float]]:
    """Shares in a fixed ``order``, then names that a newer version has added."""
    known = [(name, shares[name]) for name in order if name in shares]
    return known + [(name, share) for name, share in shares.items() if name not in order]
