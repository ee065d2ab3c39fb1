"""Charts of characters, legible without colour: areas, points with intervals, histograms."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rich.text import Text

from lndrl.view.text import SPARKS, beside, finite, fit, resample, styled

LABEL = 8
"""Cells left of a chart for the values of its upper and lower edge."""


def area(
    values: Sequence[float | None],
    width: int,
    height: int,
    low: float | None = None,
    high: float | None = None,
) -> list[str]:
    """``height`` rows, the top one first, filled up to ``values`` in eighths of a row.

    The lowest value is one eighth high, what has no number is blank. ``low`` and ``high`` are the
    edges, by default the lowest and the highest value. Shorter than ``width`` where there are
    fewer values.
    """
    points = resample(values, width)
    numbers = finite(points)
    if not numbers or width <= 0:
        return [""] * height
    bottom = min(numbers) if low is None else low
    span = (max(numbers) if high is None else high) - bottom
    full = height * 8
    columns = [
        0 if p is None or not math.isfinite(p) else _eighths(p, bottom, span, full) for p in points
    ]
    rows = []
    for row in range(height):
        below = (height - 1 - row) * 8
        filled = (min(max(eighths - below, 0), 8) for eighths in columns)
        rows.append("".join(SPARKS[n - 1] if n else " " for n in filled))
    return rows


def _eighths(value: float, bottom: float, span: float, full: int) -> int:
    share = (value - bottom) / span if span > 1e-12 else 0.0
    return 1 + round(min(max(share, 0.0), 1.0) * (full - 1))


def area_chart(
    values: Sequence[float | None],
    width: int,
    height: int,
    colour: str,
    show: Callable[[float], str],
) -> list[Text]:
    """``area`` with the values of its edges beside it, in exactly ``width`` cells."""
    numbers = finite(values)
    top, bottom = (show(max(numbers)), show(min(numbers))) if numbers else ("", "")
    lines = []
    for i, row in enumerate(area(values, width - LABEL, height)):
        label = top if i == 0 else bottom if i == height - 1 else ""
        line = styled(f"{label[: LABEL - 1]:>{LABEL - 1}} ", "dim").append(row, style=colour)
        lines.append(fit(line, width))
    return lines


@dataclass(frozen=True)
class Interval:
    """A measured value at ``x``, and the interval that holds the true one."""

    x: float
    value: float
    low: float
    high: float


def interval_chart(
    points: Sequence[Interval],
    width: int,
    height: int,
    colour: str,
    show: Callable[[float], str],
    mark: str = "●",
) -> list[Text]:
    """Each point at its place between the first ``x`` and the last, its interval as a bar.

    Of several in one column the last is drawn. The edges are those of all intervals.
    """
    if not points or width <= LABEL or height <= 0:
        return [fit(Text(), width) for _ in range(height)]
    low, high = min(p.low for p in points), max(p.high for p in points)
    first, last = min(p.x for p in points), max(p.x for p in points)
    room = width - LABEL

    def row_of(value: float) -> int:
        share = (value - low) / (high - low) if high - low > 1e-12 else 0.0
        return height - 1 - round(share * (height - 1))

    columns: dict[int, Interval] = {}
    for point in points:
        share = (point.x - first) / (last - first) if last > first else 0.0
        columns[round(share * (room - 1))] = point
    lines = []
    for row in range(height):
        label = show(high) if row == 0 else show(low) if row == height - 1 else ""
        line = styled(f"{label[: LABEL - 1]:>{LABEL - 1}} ", "dim")
        for column in range(room):
            found = columns.get(column)
            if found is not None and row_of(found.value) == row:
                line.append(mark, style=f"bold {colour}")
            elif found is not None and row_of(found.high) <= row <= row_of(found.low):
                line.append("│", style=colour)
            else:
                line.append(" ")
        lines.append(fit(line, width))
    return lines


def span_line(left: str, right: str, width: int) -> Text:
    """What the left and the right edge of a chart stand for."""
    return beside(styled(" " * LABEL + left, "dim"), styled(right, "dim"), width)


def bars(shares: Sequence[tuple[str, float]], width: int, colour: str) -> list[Text]:
    """A histogram on its side: a row for each ``(label, share)``, the largest share fills it."""
    if not shares:
        return []
    margin = max(len(label) for label, _ in shares) + 1
    most = max(share for _, share in shares)
    room = max(width - margin - 9, 1)
    lines = []
    for label, share in shares:
        eighths = round(share / most * room * 8) if most > 0 else 0
        whole, part = divmod(eighths, 8)
        bar = "█" * whole + (" ▏▎▍▌▋▊▉"[part] if part else "")
        line = styled(f"{label:>{margin - 1}} ", "dim").append(f"{bar:<{room}}", style=colour)
        lines.append(fit(line.append(f"{100 * share:>7.1f} %", style="default"), width))
    return lines
