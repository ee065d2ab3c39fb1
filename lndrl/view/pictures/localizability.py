"""Drawings of how well a scan pins the pose down, all over a place.

The colour of the floor is the deviation (m) along the direction that a scan tells least about,
its geometric mean over all headings. Where it matters which way the robot looks, a line points
from a dot along the best heading: the longer, the more.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colors
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from lndrl.maps.localizability import LocalizabilityField
from lndrl.view.palette import BLUE, GOAL, INK, PAPER, SLATE, WALL
from lndrl.view.pictures.fitting import add_legend
from lndrl.view.pictures.scenario import mark_metres, region, save_small
from lndrl.world import Place

_LONGEST_SIDE = 9.0  # inches
_MARGIN, _TICKS, _HEAD, _LEGEND, _BAR = 0.12, 0.35, 0.42, 0.40, 0.95  # inches
_NARROWEST = 5.0  # inches
_LEAST = 0.03  # m, lower end of the colours
_EVERY = 1.0  # m between two lines
_MATTERS = 1.5  # times better than the worst heading: from there on a line is drawn
_COLOURS = "YlOrRd"


def draw_localizability(place: Place, field: LocalizabilityField, axes: Axes) -> Any:
    """Draw ``field`` over the walls of ``place`` into ``axes``; returns what has the colours."""
    width, height = place.grid.size
    rows, columns = field.free.shape
    logarithm = np.log(np.maximum(field.deviation, _LEAST)).mean(axis=2)
    shown = axes.imshow(
        np.exp(logarithm),
        origin="lower",
        extent=(0, columns * field.spacing, 0, rows * field.spacing),
        cmap=_COLOURS,
        norm=colors.LogNorm(_LEAST, max(field.sensor.farthest, 2 * _LEAST)),
        interpolation="nearest",
        zorder=0,
    )
    axes.imshow(
        np.where(place.grid.occupied, 1.0, np.nan),
        origin="lower",
        extent=(0, width, 0, height),
        cmap=colors.ListedColormap([WALL]),
        interpolation="nearest",
        zorder=1,
    )
    lines = best_headings(field)
    axes.add_collection(LineCollection(list(lines), colors=[BLUE], linewidths=1.0, zorder=3))
    axes.scatter(lines[:, 0, 0], lines[:, 0, 1], s=5, color=BLUE, linewidths=0, zorder=3)
    for task in place.scenario.robot:
        for box in (task.start, task.goal):
            axes.add_patch(region(box))
    axes.set(xlim=(0, width), ylim=(0, height), aspect="equal")
    mark_metres(place, axes)
    return shown


def best_headings(field: LocalizabilityField) -> NDArray[np.float64]:
    """Lines (n, 2, 2) (m) from places about a metre apart along their best headings, where the
    worst is half as bad again; as long as its logarithm, a metre at most.
    """
    stride = max(1, round(_EVERY / field.spacing))
    chosen = np.zeros_like(field.free)
    chosen[stride // 2 :: stride, stride // 2 :: stride] = True
    rows, columns = np.nonzero(chosen & field.free)
    here = field.deviation[rows, columns].astype(np.float64)
    ratio = here.max(axis=1) / here.min(axis=1)
    # Of a run of headings that are about as good, its middle.
    angle = 2.0 * np.pi * np.arange(here.shape[1]) / here.shape[1]
    weight = np.where(here <= 1.1 * here.min(axis=1, keepdims=True), 1.0, 0.0)
    across, up = weight @ np.cos(angle), weight @ np.sin(angle)
    size = np.hypot(across, up)
    keep = (ratio > _MATTERS) & (size > 0.5)
    length = 0.9 * stride * field.spacing * np.minimum(np.log(ratio) / np.log(20.0), 1.0)
    start = (np.stack([columns, rows], axis=1) + 0.5) * field.spacing
    ahead = np.stack([across, up], axis=1) / np.maximum(size, 1e-9)[:, None]
    end = start + ahead * length[:, None]
    lines: NDArray[np.float64] = np.stack([start, end], axis=1)[keep]
    return lines


def localizability_figure(place: Place, field: LocalizabilityField, title: str = "") -> Figure:
    """A figure of the field with title, colour bar and legend; the longer side is 9 inches."""
    width, height = place.grid.size
    scale = _LONGEST_SIDE / max(width, height * 1.2)
    across, up = width * scale, height * scale
    wide = max(across + _TICKS + _BAR + 2 * _MARGIN, _NARROWEST)
    figure = Figure(figsize=(wide, _LONGEST_SIDE), facecolor=PAPER)
    FigureCanvasAgg(figure)
    style = {"fontsize": 8.5, "labelcolor": INK, "handletextpad": 0.6, "columnspacing": 1.6}
    legend = max(_LEGEND, add_legend(figure, _legend(), 3, **style))
    tall = up + _TICKS + _HEAD + legend
    figure.set_size_inches(wide, tall)
    left = _MARGIN + _TICKS
    bottom = (legend + _TICKS) / tall
    axes = figure.add_axes((left / wide, bottom, across / wide, up / tall))
    shown = draw_localizability(place, field, axes)
    axes.set_title(title or place.scenario.name, loc="left", size=11, color=INK, pad=7)
    side = figure.add_axes(((left + across + 0.15) / wide, bottom, 0.16 / wide, up / tall))
    bar = figure.colorbar(shown, cax=side)
    marks = [m for m in (0.03, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0) if m <= field.sensor.farthest]
    bar.set_ticks(marks, labels=[f"{mark:g}" for mark in marks])
    bar.ax.minorticks_off()
    bar.ax.tick_params(colors=SLATE, labelsize=8, length=3)
    bar.set_label("m, deviation by one scan", color=INK, size=8.5)
    bar.outline.set_visible(False)
    return figure


def save_localizability(
    place: Place, field: LocalizabilityField, path: Path | str, title: str = ""
) -> None:
    """Write the picture; raises OSError where ``path`` cannot be written."""
    save_small(localizability_figure(place, field, title), path, shades=True)


def _legend() -> list[Any]:
    return [
        Patch(facecolor=WALL, label="walls"),
        Patch(facecolor=GOAL, alpha=0.35, label="starts and goals"),
        Line2D([], [], color=BLUE, marker=".", label="where to look, if it matters", markevery=[0]),
    ]
