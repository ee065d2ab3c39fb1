"""A page of episodes that went badly, with the reason each ended."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from lndrl.view.palette import BELIEF_DARK, GOAL, INK, OUTCOME, PAPER, PERSON, SLATE, TRUTH
from lndrl.view.pictures.fitting import add_legend, shortened
from lndrl.view.pictures.trajectories import DASHES, draw_people_paths
from lndrl.view.pictures.world import (
    View,
    draw_floor,
    draw_goal,
    draw_people,
    draw_robot,
    draw_scale,
)

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark.replay import Drive

_COLUMNS = 5
_SIDE, _GAP, _HEAD, _TITLE, _LEGEND = 2.9, 0.16, 0.64, 0.4, 0.36  # inches
_SMALLEST_VIEW, _AROUND = 9.0, 1.2  # m


@dataclass(frozen=True)
class Panel:
    """A drive and, where it ended otherwise than is recorded, what is recorded."""

    drive: Drive
    difference: str = ""


def worst_figure(panels: Sequence[Panel], title: str = "") -> Figure:
    """A page with a panel for each drive in the order given, five in a row."""
    columns = min(_COLUMNS, len(panels))
    rows = math.ceil(len(panels) / columns)
    width = columns * (_SIDE + _GAP) + _GAP
    figure = Figure(figsize=(width, _SIDE), facecolor=PAPER)
    FigureCanvasAgg(figure)
    style = {"fontsize": 8.5, "labelcolor": INK}
    legend = max(_LEGEND, add_legend(figure, _legend(), 3 if columns < 3 else 6, **style))
    height = _TITLE + rows * (_HEAD + _SIDE + _GAP) + legend
    figure.set_size_inches(width, height)
    for i, panel in enumerate(panels):
        row, column = divmod(i, columns)
        left = _GAP + column * (_SIDE + _GAP)
        bottom = height - _TITLE - (row + 1) * (_HEAD + _SIDE) - row * _GAP
        box = (left / width, bottom / height, _SIDE / width, _SIDE / height)
        axes = figure.add_axes(box)
        draw_panel(panel, axes)
        _write_head(panel, axes, i + 1)
    title = shortened(title, 11.5, width - 2 * _GAP, "bold")
    figure.text(
        _GAP / width, 1 - 0.22 / height, title, size=11.5, color=INK, va="center", weight="bold"
    )
    return figure


def draw_panel(panel: Panel, axes: Axes) -> None:
    """Draw one drive into square ``axes``: everything that it and its goal cover."""
    drive, end = panel.drive, panel.drive.end
    left, right, bottom, top = view = view_of(drive)
    draw_floor(end, axes)
    draw_goal(end, axes)
    draw_people_paths(drive, axes)
    draw_people(end, axes)
    axes.plot(
        *drive.pose_estimated[:, :2].T,
        color=BELIEF_DARK,
        linewidth=1.3,
        linestyle=DASHES,
        zorder=6,
    )
    axes.plot(*drive.pose_true[:, :2].T, color=TRUTH, linewidth=1.7, zorder=5)
    x, y = (float(v) for v in end.start_pose[:2])
    axes.scatter(x, y, s=22, facecolors=PAPER, edgecolors=TRUTH, linewidths=1.2, zorder=6)
    draw_robot(end, axes, max(end.robot_radius, 0.016 * (right - left)))
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set(color=SLATE, linewidth=0.8)
    draw_scale(axes, view)


def view_of(drive: Drive) -> View:
    """A square around start, goal and both paths."""
    points = np.vstack([drive.pose_true[:, :2], drive.pose_estimated[:, :2], [drive.end.goal]])
    low, high = points.min(axis=0), points.max(axis=0)
    half = max(float((high - low).max()) + 2 * _AROUND, _SMALLEST_VIEW) / 2
    x, y = ((low + high) / 2).tolist()
    return x - half, x + half, y - half, y + half


def save_worst(panels: Sequence[Panel], path: Path | str, title: str = "", dpi: int = 110) -> None:
    """Write the page; raises OSError where ``path`` cannot be written."""
    worst_figure(panels, title).savefig(path, dpi=dpi)


def _write_head(panel: Panel, axes: Axes, place: int) -> None:
    """Three lines: which episode, why it ended, and what is recorded where that differs."""
    drive = panel.drive
    name = f"{place}.  {drive.scenario}, episode {drive.episode}"
    words = (
        (0.45, name, INK, "normal"),
        (0.27, drive.reason, OUTCOME[drive.record.outcome], "bold"),
        (0.09, panel.difference, INK, "normal"),
    )
    for up, text, colour, weight in words:
        text = shortened(text, 8.5, _SIDE + _GAP, weight)
        axes.text(
            0.0, 1 + up / _SIDE, text, transform=axes.transAxes, va="center", size=8.5,
            color=colour, weight=weight,
        )  # fmt: skip


def _legend() -> list[Line2D]:
    hollow: dict[str, Any] = {"marker": "o", "markersize": 6, "markerfacecolor": "none"}
    return [
        Line2D([], [], color=TRUTH, marker="o", markersize=6, linewidth=1.7, label="robot"),
        Line2D(
            [], [], color=BELIEF_DARK, linewidth=1.3, linestyle=DASHES,
            label="where it believes to be", **hollow,
        ),
        Line2D([], [], color=PERSON[""], linewidth=0.9, marker="o", markersize=7, label="people"),
        Line2D([], [], color=TRUTH, linestyle="", label="start", **hollow),
        Line2D([], [], color=GOAL, linestyle="", marker="*", markersize=9, label="goal"),
    ]  # fmt: skip
