"""A sweep's learning curves: a panel per group of variants, each beside the base."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.view.palette import BLUE, GREEN, INK, ORANGE, PAPER, PINK, SKY, SLATE, VERMILLION
from lndrl.view.pictures.fitting import shortened
from lndrl.view.pictures.learning.curves import dress
from lndrl.wording import counted

if TYPE_CHECKING:
    from lndrl.evaluation.sweep import RunFigures, SweepFigures

_COLOURS = (VERMILLION, BLUE, GREEN, PINK, ORANGE, SKY)
_POINTS = 200
_COLUMNS = 4

Floats = NDArray[np.float64]


def save_sweep(figures: SweepFigures, path: Path | str, dpi: int = 110) -> None:
    """Write the picture: arrival in per cent against steps, mean over seeds; band: all of them.

    Raises UserError before any run is finished, OSError where ``path`` cannot be written.
    """
    if not figures.runs:
        raise UserError(f"{path}: there is nothing to draw; no run of the sweep is finished")
    base, *others = figures.sweep.variants
    groups: dict[str, list[str]] = {}
    for variant in others:
        groups.setdefault(variant.group, []).append(variant.name)
    rows = math.ceil(len(groups) / _COLUMNS)
    columns = math.ceil(len(groups) / rows)
    size = (max(3.3 * columns, 5.0), 2.5 * rows + 0.6)
    figure = Figure(figsize=size, facecolor=PAPER, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes in grid.flat[len(groups) :]:
        axes.remove()
    for i, (axes, (key, names)) in enumerate(zip(grid.flat, groups.items(), strict=False)):
        dress(axes, key)
        _draw(axes, _runs(figures, base.name), base.name, SLATE, 1.5)
        for name, colour in zip(names, _COLOURS * len(names), strict=False):
            _draw(axes, _runs(figures, name), name, colour, 1.9)
        axes.legend(loc="upper left", frameon=False, fontsize=8, labelcolor="linecolor")
        if i + columns >= len(groups):
            axes.tick_params(labelbottom=True)
            axes.set_xlabel("environment steps", color=INK, size=9)
    first = grid[0, 0]
    first.set_xlim(0, figures.sweep.spec.steps)
    highest = max(max(run.curve, default=0.0) for run in figures.runs)
    first.set_ylim(0, max(5.0, 115.0 * highest))
    first.yaxis.set_major_locator(MaxNLocator(5))
    first.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g} %"))
    spec = figures.sweep.spec
    over = counted(len(spec.seeds), "seed")
    title = f"sweep {figures.sweep.name}: arrived, mean and range over {over}"
    title = shortened(title, 11, 0.98 * size[0])
    figure.suptitle(title, x=0.01, ha="left", size=11, color=INK)
    figure.savefig(path, dpi=dpi)


def _runs(figures: SweepFigures, name: str) -> list[RunFigures]:
    return [run for run in figures.runs if run.variant == name]


def _draw(axes: Axes, runs: Sequence[RunFigures], name: str, colour: str, width: float) -> None:
    if not runs:
        return
    steps, curves = _aligned(runs)
    count = f" ({len(runs)})" if len(runs) > 1 else " (1 run)"
    axes.fill_between(
        steps, curves.min(axis=0), curves.max(axis=0), color=colour, alpha=0.16, linewidth=0
    )
    axes.plot(steps, curves.mean(axis=0), color=colour, linewidth=width, label=name + count)


def _aligned(runs: Sequence[RunFigures]) -> tuple[Floats, Floats]:
    """Common steps (p,) and the curves there (runs, p), in per cent."""
    steps = np.linspace(0.0, min(run.steps for run in runs), _POINTS)
    curves = [100.0 * np.interp(steps, [0, *run.curve_steps], [0.0, *run.curve]) for run in runs]
    return steps, np.array(curves)
