"""The picture of how two methods behave otherwise: a map each of turning, waiting and ways.

Orange is where the first method does more of it, blue where the second does; white is no
difference, grey where too few came to say.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from lndrl.view.palette import BLUE, INK, PAPER, SLATE, VERMILLION
from lndrl.view.pictures.fitting import shortened
from lndrl.view.pictures.world import draw_floor, draw_scale
from lndrl.view.text import MISSING

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lndrl.evaluation.behaviour import BehaviourReport, Numbers

_WIDTH, _MARGIN, _GAP = 12.0, 0.3, 0.35  # inches
_HEAD, _NAME, _BAR, _BAR_WORDS, _ROW = 0.42, 0.3, 0.12, 0.62, 0.24  # inches
_WIDE = 2.2  # a place so many times wider than high has its maps above each other
_WIDEST = 9.5  # inches; a map alone in its row
_BLANK = "#D3D7DE"
_COLOURS = LinearSegmentedColormap.from_list("behaviour", [BLUE, PAPER, VERMILLION])
_TITLES = {
    "turning": ("turns more", "mean turn rate (rad/s)"),
    "waiting": ("waits more", "steps below 0.05 m/s (points)"),
    "ways": ("goes there more", "share of episodes (points)"),
}
_LEAST = {"turning": 0.05, "waiting": 2.0, "ways": 5.0}
"""Ends of a scale at least: no colour shouts for next to nothing."""
NUMBERS = (
    "method", "episodes", "arrived", "turn per step (rad)", "waiting", "path, both arrived (m)",
    "lost per 1,000 steps",
)  # fmt: skip
"""Heads of the table of numbers."""
_STOPS = (0.0, 0.27, 0.36, 0.53, 0.63, 0.81, 1.0)
"""Right ends of its columns (the first one's left end) as shares of the width."""


def behaviour_figure(report: BehaviourReport) -> Figure:
    """A figure of ``report``: three maps, each with its scale, and the numbers below."""
    across, up = report.grid.size
    columns = 1 if across > _WIDE * up else 3
    slot = min((_WIDTH - 2 * _MARGIN - (columns - 1) * _GAP) / columns, _WIDEST)
    tall = slot * up / across
    block = _NAME + tall + _BAR_WORDS
    table = _ROW * 4.6
    height = _HEAD + block * (3 // columns) + table
    figure = Figure(figsize=(_WIDTH, height), facecolor=PAPER)
    FigureCanvasAgg(figure)
    first, second = report.methods
    count = report.numbers[0].episodes
    title = f"{first} less {second} on {report.scenario}, {count:,} episodes"
    title = shortened(title, 12, _WIDTH - 2 * _MARGIN, "bold")
    x, y = _MARGIN / _WIDTH, 1 - 0.6 * _HEAD / height
    figure.text(x, y, title, size=12, color=INK, weight="bold")
    for i, (name, values) in enumerate(report.maps.items()):
        left = _MARGIN + (i % columns) * (slot + _GAP)
        bottom = height - _HEAD - block * (i // columns) - _NAME - tall
        place = (left / _WIDTH, bottom / height, slot / _WIDTH, tall / height)
        axes = figure.add_axes(place)
        limit = _draw_map(report, values, _LEAST[name], axes)
        what, unit = _TITLES[name]
        axes.set_title(f"{what}: {unit}", loc="left", size=9.5, color=INK, pad=4)
        bar = (left / _WIDTH, (bottom - 0.1 - _BAR) / height, slot / _WIDTH, _BAR / height)
        _draw_scale(figure.add_axes(bar), limit, report.methods, slot)
    _draw_numbers(report, figure, table, height)
    return figure


def save_behaviour(report: BehaviourReport, path: Path | str, dpi: int = 110) -> None:
    """Write the picture; raises OSError where ``path`` cannot be written."""
    behaviour_figure(report).savefig(path, format="png", dpi=dpi)


def number_cells(numbers: Numbers) -> tuple[str, ...]:
    """What stands under ``NUMBERS``."""
    low, high = numbers.hazard.interval
    return (
        numbers.method,
        f"{numbers.episodes:,}",
        f"{numbers.arrived:.3f}",
        f"{numbers.turn:.4f}",
        f"{100 * numbers.waiting:.1f} %",
        MISSING if numbers.path is None else f"{numbers.path:.2f}",
        f"{numbers.hazard.value:.2f} ({low:.2f}–{high:.2f})",
    )


def _draw_map(
    report: BehaviourReport, values: NDArray[np.float64], least: float, axes: Axes
) -> float:
    """Shade the cells; walls keep their colour. Returns where the scale ends."""
    grid = report.grid
    known = np.abs(values[np.isfinite(values)])
    # A single odd cell must not make all others pale.
    limit = max(least, float(np.quantile(known, 0.97)) if len(known) else 0.0)
    draw_floor(grid, axes)
    row, column = ((np.arange(n) + 0.5) * grid.resolution / report.cell for n in grid.shape)
    at = np.ix_(
        np.minimum(row.astype(int), values.shape[0] - 1),
        np.minimum(column.astype(int), values.shape[1] - 1),
    )
    colours = _COLOURS(np.clip(0.5 + 0.5 * values / limit, 0.0, 1.0))
    colours[np.isnan(values)] = (*(int(_BLANK[k : k + 2], 16) / 255 for k in (1, 3, 5)), 1.0)
    image = np.array(colours)[at]
    image[..., 3] = grid.free
    across, up = grid.size
    axes.imshow(image, origin="lower", extent=(0.0, across, 0.0, up), interpolation="nearest")
    axes.set(xlim=(0.0, across), ylim=(0.0, up), aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set(color=SLATE, linewidth=0.8)
    draw_scale(axes, (0.0, across, 0.0, up))
    return limit


def _draw_scale(axes: Axes, limit: float, methods: tuple[str, str], slot: float) -> None:
    figure = axes.figure
    assert isinstance(figure, Figure)
    shades = ScalarMappable(Normalize(-limit, limit), _COLOURS)
    bar = figure.colorbar(shades, cax=axes, orientation="horizontal", extend="both")
    bar.outline.set(edgecolor=SLATE, linewidth=0.6)
    bar.ax.xaxis.set_major_locator(MaxNLocator(4, symmetric=True))
    bar.ax.tick_params(colors=INK, labelsize=8, length=2.5)
    ends = ((0.0, "left", methods[1], BLUE), (1.0, "right", methods[0], VERMILLION))
    for x, side, name, colour in ends:
        words = shortened(f"{name} more", 8.5, 0.47 * slot, "bold")
        axes.annotate(
            words,
            (x, 0.0),
            xycoords="axes fraction",
            xytext=(0, -16),
            textcoords="offset points",
            ha=side,
            va="top",
            size=8.5,
            weight="bold",
            color=colour,
        )


def _draw_numbers(report: BehaviourReport, figure: Figure, table: float, height: float) -> None:
    from lndrl.evaluation.behaviour import FEW_EPISODES, FEW_STEPS

    wide = _WIDTH - 2 * _MARGIN
    rows = [NUMBERS, *(number_cells(each) for each in report.numbers)]
    for i, cells in enumerate(rows):
        y = (table - (i + 0.9) * _ROW) / height
        for k, (stop, words) in enumerate(zip(_STOPS, cells, strict=True)):
            x = (_MARGIN + stop * wide) / _WIDTH
            figure.text(
                x,
                y,
                shortened(words, 9, 0.2 * wide) if k == 0 else words,
                ha="right" if k else "left",
                size=9,
                color=SLATE if i == 0 else INK,
            )
    note = (
        f"cells of {report.cell:g} m; grey: fewer than {FEW_STEPS} steps of either method, "
        f"or {FEW_EPISODES} episodes of both"
    )
    figure.text(_MARGIN / _WIDTH, (table - 4.0 * _ROW) / height, note, size=8, color=SLATE)
