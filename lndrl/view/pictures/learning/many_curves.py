"""The learning curves of several runs in one picture and one table."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.view.palette import BLUE, GREEN, INK, ORANGE, PAPER, PINK, SKY, SLATE, VERMILLION
from lndrl.view.pictures.fitting import shortened
from lndrl.view.pictures.learning.curves import (
    SMOOTHING,
    Row,
    column,
    dress,
    smooth,
    table_cell,
    value_at,
)
from lndrl.wilson import wilson_interval
from lndrl.wording import counted

PANELS = ("arrived", "collided", "lost")
HEAD = ("run", "kind", "steps", "episodes", "arrived", "collided", "lost", "timeout")
"""Columns of the table; ``kind`` is training, sampled or greedy, the last two of validation."""

_COLOURS = (BLUE, VERMILLION, GREEN, PINK, ORANGE, SKY, INK, SLATE)
_DASHES: tuple[str | tuple[int, tuple[float, ...]], ...] = ("-", (0, (4, 1.4)), (0, (1.2, 1.2)))
_MARKS = "os^Dv"
_WIDTH, _HEIGHT, _NAME = 12.5, 5.4, 1.9  # inches
_ROW = 0.2  # inches that a line of the legend takes

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Curves:
    """Of one run: ``rows`` of training and the ``validated`` versions, as ``metrics.jsonl`` has
    them."""

    name: str
    rows: Sequence[Row]
    validated: Sequence[Row] = ()

    @property
    def steps(self) -> Floats:
        """Environment steps at each row (n,); their numbers where no row has any."""
        found = column(self.rows, "steps")
        if np.isfinite(found).any():
            return found
        return np.arange(len(self.rows), dtype=np.float64)

    def share(self, outcome: str, window: float) -> tuple[Floats, Floats]:
        """Steps (k,) and per cent (k,) that ended in ``outcome``, a moving mean over ``window``
        steps; rows in which no episode ended are left out."""
        steps, values = self.steps, 100 * column(self.rows, f"episodes.{outcome}")
        known = np.isfinite(steps) & np.isfinite(values)
        steps, values = steps[known], values[known]
        if not len(steps):
            return steps, values
        return steps, smooth(values, min(1.0, window / max(float(steps[-1]), 1.0)))


def names_of(paths: Sequence[Path]) -> list[str]:
    """What to call runs: by their folders' names, by their paths where two are called alike."""
    names = [path.resolve().name for path in paths]
    return [
        str(path) if names.count(name) > 1 else name
        for path, name in zip(paths, names, strict=True)
    ]


def write_many_csv(runs: Sequence[Curves], path: Path | str) -> None:
    """Write the shares of all ``runs``, a line per update and validated version, see ``HEAD``.

    Raises OSError where ``path`` cannot be written.
    """
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEAD)
        for run in runs:
            writer.writerows([run.name, *line] for line in _lines(run))


def _lines(run: Curves) -> Iterator[list[str]]:
    keys = ("steps", *(f"episodes.{name}" for name in ("count", *HEAD[4:])))
    for row in run.rows:
        yield ["training", *(table_cell(value_at(row, key)) for key in keys)]
    for row in run.validated:
        for kind in ("sampled", "greedy"):
            counts = row[kind]
            shares = (table_cell(counts[name] / counts["episodes"]) for name in HEAD[4:])
            yield [kind, str(row["steps"]), str(counts["episodes"]), *shares]


def save_many_curves(runs: Sequence[Curves], path: Path | str, dpi: int = 130) -> None:
    """Write the picture; raises UserError without a row, OSError where it cannot be written."""
    if not any(run.rows for run in runs):
        raise UserError(f"{path}: there is nothing to draw; learning curves need a row")
    many_figure(runs).savefig(path, dpi=dpi)


def many_figure(runs: Sequence[Curves]) -> Figure:
    """Arrived large, collided and lost small, over steps; the legend has the best run first.

    Lines are moving means of training over the same number of steps for all, marks the validated
    versions with their 95 % Wilson intervals. Before the first step nobody arrives, and that would
    flatten all else: such a version is in the table alone.
    """
    longest = max(float(np.nanmax(run.steps, initial=1.0)) for run in runs)
    window = SMOOTHING * longest
    height = max(_HEIGHT, _ROW * (len(runs) + 4) + 0.6)
    figure = Figure(figsize=(_WIDTH, height), facecolor=PAPER, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.5, 1.0))
    large = figure.add_subplot(grid[:, 0])
    small = [figure.add_subplot(grid[i, 1], sharex=large) for i in range(2)]
    ends: list[float | None] = []
    for axes, outcome in zip((large, *small), PANELS, strict=True):
        last = [_draw(axes, run, outcome, window, i) for i, run in enumerate(runs)]
        ends = ends or last
        dress(axes, f"{outcome} (%)")
        axes.yaxis.set_major_locator(MaxNLocator(5))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        highest = axes.dataLim.y1 or 1.0  # nothing but zeros
        axes.set_ylim(-0.03 * highest, 1.03 * highest)  # marks at 0 are whole
    large.set_ylim(max(0.0, 10.0 * np.floor(0.1 * large.dataLim.y0)), 100.5)
    large.set_xlim(0.0, 1.015 * longest)
    small[0].tick_params(labelbottom=False)
    for axes in (large, small[1]):
        axes.set_xlabel("environment steps", color=INK, size=9)
    _add_legend(figure, runs, ends, window)
    title = f"learning curves of {counted(len(runs), 'run')}"
    figure.suptitle(title, x=0.01, ha="left", size=12, color=INK)
    return figure


def _style(i: int) -> dict[str, object]:
    """Of the ``i``-th run: eight colours, then the same ones dashed."""
    dashes = _DASHES[i // len(_COLOURS) % len(_DASHES)]
    return {"color": _COLOURS[i % len(_COLOURS)], "linestyle": dashes, "linewidth": 1.7}


def _draw(axes: Axes, run: Curves, outcome: str, window: float, i: int) -> float | None:
    """Draw a run's training and validation; returns where training ended, in per cent."""
    steps, shares = run.share(outcome, window)
    style, mark = _style(i), _MARKS[i % len(_MARKS)]
    if len(steps):
        axes.plot(steps, shares, **style, zorder=3)  # type: ignore[arg-type]
        # Of runs that began alike the shorter one would be hidden; its end is not.
        axes.plot(steps[-1:], shares[-1:], color=str(style["color"]), marker=mark, markersize=6)
    trained = [row for row in run.validated if row["steps"]]
    counts = [row["sampled"] for row in trained]
    if counts:
        rates = np.array([100 * each[outcome] / each["episodes"] for each in counts])
        ends = 100 * np.array([wilson_interval(each[outcome], each["episodes"]) for each in counts])
        axes.errorbar(
            [row["steps"] for row in trained],
            rates,
            yerr=np.maximum(0.0, np.stack([rates - ends[:, 0], ends[:, 1] - rates])),
            fmt=mark,
            markersize=4.5,
            markeredgecolor=PAPER,
            markeredgewidth=0.5,
            color=str(style["color"]),
            elinewidth=0.9,
            zorder=4,
        )
    return float(shares[-1]) if len(shares) else None


def _add_legend(
    figure: Figure, runs: Sequence[Curves], ends: Sequence[float | None], window: float
) -> None:
    """On the right: each run with where it ended, the best first, and what lines and marks are."""
    known = [-1.0 if end is None else end for end in ends]
    order = sorted(range(len(runs)), key=lambda i: -known[i])
    handles = []
    for i in order:
        end = ends[i]
        share = "" if end is None else f"  {end:.0f} %"
        name = shortened(runs[i].name, 9, _NAME)
        style = {**_style(i), "marker": _MARKS[i % len(_MARKS)], "markersize": 4.5}
        handles.append(Line2D([], [], label=name + share, **style))  # type: ignore[arg-type]
    words = f"in training, moving\nmean of {window:,.0f} steps"
    handles.append(Line2D([], [], color=SLATE, linewidth=1.7, label=words))
    if any(run.validated for run in runs):
        mark = Line2D(
            [], [], color=SLATE, linestyle="", marker="o", markersize=4.5,
            label="validated, with\n95 % interval",
        )  # fmt: skip
        handles.append(mark)
    figure.legend(
        handles=handles,
        loc="outside right upper",
        frameon=False,
        fontsize=9,
        labelcolor=INK,
        handlelength=2.6,
    )
