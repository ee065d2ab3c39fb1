"""The picture of why a planner gets lost: maps with the places, and the hazard by what it did.

A diamond stands where the robot was when it was lost (hollow: it had drifted), a dotted line leads
to where it thought to be. The pink of a cell is the hazard there; where few steps were taken it is
drawn towards the mean, else a single loss in a corner would outshine all else.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from lndrl.maps.grid import OccupancyGrid
from lndrl.scenario import Scenario
from lndrl.view.palette import BELIEF, BELIEF_DARK, BLUE, FLOOR, INK, OUTCOME, PAPER, SLATE
from lndrl.view.pictures.axes import quiet
from lndrl.view.pictures.fitting import add_legend, shortened
from lndrl.view.pictures.world import draw_floor, draw_scale
from lndrl.world import Place

if TYPE_CHECKING:
    from lndrl.evaluation.hazard import Hazard
    from lndrl.evaluation.lost import Loss, LostReport

_WIDTH, _MARGIN, _GAP = 11.4, 0.25, 0.3  # inches
_HEAD, _NAME, _CHART, _AXIS, _SIDE, _LEGEND = 0.42, 0.3, 1.9, 0.62, 0.68, 0.4  # inches
_COLUMNS = 3
_WIDEST = 7.5  # inches; one map alone need not fill the page
_TALLEST = 1.25  # of a map's width; taller ones become narrower
_PRIOR = 250  # steps at the mean hazard that every cell begins with
_DARKEST = 3.0  # times the mean hazard
_FEW = 0.02  # of all steps; bins with fewer have no say in the scale
_PINK = OUTCOME["lost"]
_PLACES = "scenario"
_TITLES = {
    "turned": "turned in 4.8 s (rad)",
    "heading": "heading off before (rad)",
    "echoes": "beams with an echo",
    "people": "people within 6 m",
    "step": "steps since the start",
}
"""Of the charts: shorter than the tables' names, for six of them stand side by side."""


def lost_figure(report: LostReport, scenarios: Sequence[Scenario]) -> Figure:
    """A figure of ``report``, whose scenarios are ``scenarios``, in this order."""
    grids = [None if s.layouts else Place.build(s).grid for s in scenarios]
    columns = min(len(grids), _COLUMNS)
    slot = min((_WIDTH - 2 * _MARGIN - (columns - 1) * _GAP) / columns, _WIDEST)
    tall = [_height(report, grids, k, slot) for k in range(len(grids))]
    spots, below = _stacked(tall, columns)
    figure = Figure(figsize=(_WIDTH, _WIDTH), facecolor=PAPER)
    FigureCanvasAgg(figure)
    style = {"fontsize": 8.5, "labelcolor": INK, "handletextpad": 0.5, "columnspacing": 1.6}
    legend = max(_LEGEND, add_legend(figure, _legend(), 6, **style))
    height = _HEAD + below + _NAME + _CHART + _AXIS + legend
    figure.set_size_inches(_WIDTH, height)
    title = shortened(_title(report), 11, _WIDTH - 2 * _MARGIN, "bold")
    place = (_MARGIN / _WIDTH, 1.0 - 0.7 * _HEAD / height)
    figure.text(*place, title, size=11, color=INK, weight="bold")
    for k, (column, down) in enumerate(spots):
        left, bottom = _MARGIN + column * (slot + _GAP), height - _HEAD - down - tall[k]
        inches = (left / _WIDTH, bottom / height, slot / _WIDTH, tall[k] / height)
        _draw_map(report, report.scenarios[k], grids[k], figure.add_axes(inches), slot)
    _draw_charts(report, figure, legend + _AXIS, height)
    return figure


def _stacked(tall: Sequence[float], columns: int) -> tuple[list[tuple[int, float]], float]:
    """Column and distance from the top (inches) of maps so ``tall``, and how far they reach.

    Each goes where most room is left: maps differ in shape.
    """
    filled = [0.0] * columns
    spots = []
    for height in tall:
        column = filled.index(min(filled))
        spots.append((column, filled[column] + _NAME))
        filled[column] += _NAME + height
    return spots, max(filled)


def save_lost(
    report: LostReport, scenarios: Sequence[Scenario], path: Path | str, dpi: int = 110
) -> None:
    """Write the picture; raises OSError where ``path`` cannot be written."""
    lost_figure(report, scenarios).savefig(path, format="png", dpi=dpi)


def _title(report: LostReport) -> str:
    hazard = report.hazard
    low, high = hazard.interval
    return (
        f"{report.planner} on {report.world}: lost in {hazard.count} of {len(report.traces):,} "
        f"episodes, {hazard.value:.2f} per 1,000 control steps ({low:.2f} to {high:.2f})"
    )


def _height(
    report: LostReport, grids: Sequence[OccupancyGrid | None], k: int, width: float
) -> float:
    """Inches that a map takes."""
    across, up = _size(report, report.scenarios[k], grids[k])
    return min(up / across, _TALLEST) * width


def _size(report: LostReport, name: str, grid: OccupancyGrid | None) -> tuple[float, float]:
    """Metres; of a random scenario, whose layouts have no map in common, what was driven."""
    from lndrl.evaluation.lost import CELL

    if grid is not None:
        return grid.size
    cells = report.cells(name)
    return max(cell.x for cell in cells) + CELL, max(cell.y for cell in cells) + CELL


def _draw_map(
    report: LostReport, name: str, grid: OccupancyGrid | None, axes: Axes, width: float
) -> None:
    losses, hazard = report.losses_in(name), report.hazard_in(name)
    across, up = _size(report, name, grid)
    if grid is not None:
        draw_floor(grid, axes)
    else:
        axes.set_facecolor(FLOOR)
    _draw_cells(report, name, grid, (across, up), axes)
    _draw_losses(losses, axes)
    axes.set(xlim=(0.0, across), ylim=(0.0, up), aspect="equal", xticks=[], yticks=[], anchor="NW")
    for spine in axes.spines.values():
        spine.set_visible(False)
    draw_scale(axes, (0.0, across, 0.0, up))
    layouts = "" if grid is not None else ", layouts above each other"
    words = f"{name}: {hazard.count} lost in {hazard.steps:,} steps{layouts}"
    axes.set_title(shortened(words, 10, width), loc="left", size=10, color=INK, pad=4)


def _draw_cells(
    report: LostReport,
    name: str,
    grid: OccupancyGrid | None,
    size: tuple[float, float],
    axes: Axes,
) -> None:
    """Shade the cells in which the robot was by the hazard there; walls keep their colour."""
    from lndrl.evaluation.lost import CELL

    mean = report.hazard.count / report.hazard.steps
    shades = np.zeros((int(size[1] / CELL) + 1, int(size[0] / CELL) + 1))
    for cell in report.cells(name):
        steps, lost = cell.hazard.steps, cell.hazard.count
        shrunk = (lost + mean * _PRIOR) / (steps + _PRIOR)
        share = min(shrunk / (_DARKEST * mean), 1.0) if mean > 0.0 else 0.0
        row, column = int(cell.y / CELL), int(cell.x / CELL)
        if 0 <= row < shades.shape[0] and 0 <= column < shades.shape[1]:
            shades[row, column] = 0.06 + 0.6 * share
    across, up = shades.shape[1] * CELL, shades.shape[0] * CELL
    if grid is not None:
        centres = [(np.arange(n) + 0.5) * grid.resolution / CELL for n in grid.shape]
        shades = shades[np.ix_(centres[0].astype(int), centres[1].astype(int))] * grid.free
        across, up = grid.size
    image = np.empty((*shades.shape, 4))
    image[..., :3] = to_rgb(_PINK)
    image[..., 3] = shades
    axes.imshow(image, origin="lower", extent=(0.0, across, 0.0, up), interpolation="nearest")


def _draw_losses(losses: Sequence[Loss], axes: Axes) -> None:
    if not losses:
        return
    alpha = float(np.clip(12.0 / len(losses), 0.25, 0.9))
    lines = [((loss.x, loss.y), (loss.x_estimated, loss.y_estimated)) for loss in losses]
    axes.add_collection(
        LineCollection(
            lines,
            colors=[BELIEF_DARK],
            linewidths=0.9,
            linestyles=[(0, (1, 2))],
            alpha=alpha,
            zorder=3,
        )
    )
    believed = list(zip(*(end for _, end in lines), strict=True))
    axes.scatter(believed[0], believed[1], s=11, color=BELIEF, linewidths=0, alpha=alpha, zorder=4)
    for kind, face in (("jump", _PINK), ("drift", PAPER)):
        x = [loss.x for loss in losses if loss.kind == kind]
        y = [loss.y for loss in losses if loss.kind == kind]
        axes.scatter(
            x, y, s=34, marker="D", facecolors=face, edgecolors=INK, linewidths=1.0, zorder=5,
            clip_on=False,
        )  # fmt: skip


def _charts(report: LostReport) -> list[tuple[str, list[str], list[Hazard]]]:
    """What every chart counts by, the names of its bins, and the hazard in each."""
    from lndrl.evaluation.lost import RISKS, bin_names

    charts = [(_TITLES[risk], bin_names(risk), report.hazards(risk)) for risk in RISKS]
    if len(report.scenarios) > 1:
        places = [report.hazard_in(name) for name in report.scenarios]
        charts.append((_PLACES, list(report.scenarios), places))
    return charts


def _draw_charts(report: LostReport, figure: Figure, bottom: float, height: float) -> None:
    charts = _charts(report)
    gap = 0.3
    room = _WIDTH - _MARGIN - _SIDE - (len(charts) - 1) * gap
    bins = sum(len(names) for _, names, _ in charts)
    highest = _highest(report, charts)
    left = _SIDE
    for i, (name, names, hazards) in enumerate(charts):
        # Wider where there are more bins, yet wide enough for a title.
        wide = room * (0.5 / len(charts) + 0.5 * len(names) / bins)
        place = (left / _WIDTH, bottom / height, wide / _WIDTH, _CHART / height)
        axes = figure.add_axes(place)
        _draw_hazards(axes, names, hazards, report.hazard, highest, joined=name != _PLACES)
        axes.set_title(shortened(name, 9, wide), loc="left", size=9, color=INK, pad=5)
        if i == 0:
            axes.set_ylabel("lost per 1,000 steps", size=8.5, color=INK)
        else:
            axes.tick_params(labelleft=False)
        left += wide + gap


def _highest(report: LostReport, charts: Sequence[tuple[str, list[str], list[Hazard]]]) -> float:
    """Top of all charts: a bin with next to no steps must not flatten what is known."""
    least = _FEW * report.hazard.steps
    known = [h for _, _, hazards in charts for h in hazards if h.steps > least]
    rates = 1.15 * max((h.value for h in known), default=0.0)
    bounds = max((h.interval[1] for h in known if h.count), default=0.0)
    return max(rates, min(bounds, 2.0 * rates), 1.3 * report.hazard.interval[1])


def _draw_hazards(
    axes: Axes,
    names: Sequence[str],
    hazards: Sequence[Hazard],
    mean: Hazard,
    highest: float,
    joined: bool,
) -> None:
    """A dot for every bin with its interval; the area of a dot grows with the steps in the bin."""
    low, high = mean.interval
    axes.axhspan(low, high, color=SLATE, alpha=0.15, linewidth=0, zorder=1)
    axes.axhline(mean.value, color=SLATE, linewidth=0.9, linestyle="--", zorder=2)
    places = [i for i, hazard in enumerate(hazards) if hazard.steps]
    rates = [hazards[i].value for i in places]
    if joined:
        axes.plot(places, rates, color=BLUE, linewidth=1.1, alpha=0.6, zorder=3)
    for i, rate in zip(places, rates, strict=True):
        least, most = hazards[i].interval
        axes.plot([i, i], [least, most], color=BLUE, linewidth=1.4, alpha=0.75, zorder=3)
        size = 12.0 + 120.0 * hazards[i].steps / max(mean.steps, 1)
        off = rate > highest  # an arrow says that it is up there
        axes.scatter(
            [i], [0.96 * highest if off else rate], s=24.0 if off else size,
            marker="^" if off else "o", color=BLUE, edgecolors=PAPER, linewidths=0.8, zorder=4,
        )  # fmt: skip
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.set_ylim(-0.03 * highest, highest)
    turned = max(map(len, names)) > 6
    axes.set_xticks(range(len(names)), [shortened(n, 8, 0.9) for n in names])
    quiet(axes)
    if turned:
        for label in axes.get_xticklabels():
            label.set(rotation=30, ha="right", rotation_mode="anchor")


def _legend() -> list[Any]:
    mark: dict[str, Any] = {"linestyle": "", "marker": "D", "markeredgecolor": INK}
    return [
        Line2D([], [], **mark, markerfacecolor=_PINK, markersize=5.5, label="lost by a jump"),
        Line2D([], [], **mark, markerfacecolor=PAPER, markersize=5.5, label="by drifting"),
        Line2D(
            [], [], color=BELIEF_DARK, linestyle=":", marker="o", markersize=4,
            markerfacecolor=BELIEF, markeredgewidth=0, label="where it thought to be",
        ),
        Patch(facecolor=_PINK, alpha=0.45, label="hazard in cells of 2 m"),
        Line2D([], [], color=BLUE, marker="o", markersize=5, label="hazard, 95 % interval"),
        Line2D([], [], color=SLATE, linestyle="--", label="over all steps"),
    ]  # fmt: skip
