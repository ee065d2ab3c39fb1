"""Drawings of episodes: where robots went and believed to be, and how far off they were.

One column for each episode, as in the paper's Fig. 4; the methods that drove it share the map and
the two charts. A method has one colour: solid where it was, dashed where it believed to be.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from lndrl.view.palette import (
    BELIEF_DARK,
    BLUE,
    GOAL,
    GREEN,
    INK,
    ORANGE,
    OUTCOME_WORD,
    PAPER,
    PERSON,
    SKY,
    SLATE,
    VERMILLION,
)
from lndrl.view.pictures.axes import quiet
from lndrl.view.pictures.fitting import add_legend, shortened
from lndrl.view.pictures.world import draw_floor, draw_goal, draw_scale

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark.replay import Drive

METHODS = (BLUE, VERMILLION, ORANGE, SKY, INK, GREEN, BELIEF_DARK, SLATE)
"""Colours of methods, in this order; pink is the people's."""
MARK = {"arrived": "o", "collided": "X", "lost": "D", "timeout": "s"}
"""What stands where an episode ended."""
DASHES = (0, (3, 1.6))

_COLUMN, _LEFT, _RIGHT = 6.4, 0.72, 0.12  # inches
_HEAD, _ROW, _CHART, _GAP, _AXIS, _LEGEND = 0.34, 0.21, 1.35, 0.14, 0.46, 0.36  # inches


def trajectories_figure(drives: Sequence[Drive]) -> Figure:
    """A figure of ``drives``: map, position error (m) and angle error (rad) over time (s).

    Drives of one scenario and episode share a column. Methods keep their colour in all columns.
    """
    columns: dict[tuple[str, int], list[Drive]] = {}
    for drive in drives:
        columns.setdefault((drive.scenario, drive.episode), []).append(drive)
    names = list(dict.fromkeys(drive.method for drive in drives))
    colours = {name: METHODS[i % len(METHODS)] for i, name in enumerate(names)}
    inner = _COLUMN - _LEFT - _RIGHT
    map_height = max(inner * d.end.size[1] / d.end.size[0] for d in drives)
    rows = max(len(column) for column in columns.values())
    width = _COLUMN * len(columns)
    figure = Figure(figsize=(width, _COLUMN), facecolor=PAPER)
    FigureCanvasAgg(figure)
    handles = _legend({drive.record.outcome for drive in drives})
    style = {"fontsize": 8.5, "labelcolor": INK, "handletextpad": 0.4, "columnspacing": 1.1}
    legend = max(_LEGEND, add_legend(figure, handles, 9, **style))
    charts = 2 * _CHART + _GAP + _AXIS + legend
    height = _HEAD + map_height + rows * _ROW + 2 * _GAP + charts
    figure.set_size_inches(width, height)
    for i, ((scenario, episode), column) in enumerate(columns.items()):

        def place(bottom: float, tall: float, left: float = i * _COLUMN + _LEFT) -> Axes:
            return figure.add_axes((left / width, bottom / height, inner / width, tall / height))

        floor = place(height - _HEAD - map_height, map_height)
        draw_trajectories(column, floor, [colours[drive.method] for drive in column])
        title = shortened(f"{scenario}, episode {episode}", 11, inner)
        floor.set_title(title, loc="left", size=11, color=INK, pad=6)
        _name_methods(column, colours, floor, map_height)
        position = place(legend + _AXIS + _CHART + _GAP, _CHART)
        angle = place(legend + _AXIS, _CHART)
        _draw_errors(column, colours, position, angle)
    return figure


def draw_trajectories(drives: Sequence[Drive], axes: Axes, colours: Sequence[str]) -> None:
    """Draw ``drives`` of one episode into ``axes``, each in its colour: place, people, paths.

    The axes lose ticks and frame and show the whole place.
    """
    end = drives[0].end
    draw_floor(end, axes)
    draw_goal(end, axes)
    for drive in drives:
        draw_people_paths(drive, axes, alpha=0.55 / len(drives))
    for drive, colour in zip(drives, colours, strict=True):
        draw_path(drive, axes, colour)
    x, y = (float(v) for v in end.start_pose[:2])
    axes.scatter(x, y, s=30, facecolors=PAPER, edgecolors=INK, linewidths=1.3, zorder=7)
    width, height = end.size
    axes.set(xlim=(0.0, width), ylim=(0.0, height), aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)
    draw_scale(axes, (0.0, width, 0.0, height))


def draw_people_paths(drive: Drive, axes: Axes, alpha: float = 0.4) -> None:
    """Draw where everybody walked, faintly, and a dot where they stood at the end."""
    if not drive.people.shape[1]:
        return
    paths = drive.people.swapaxes(0, 1)
    style: dict[str, Any] = {"alpha": alpha, "zorder": 2.5}
    axes.add_collection(LineCollection(list(paths), colors=[PERSON[""]], linewidths=0.9, **style))
    axes.scatter(paths[:, -1, 0], paths[:, -1, 1], s=9, color=PERSON[""], linewidths=0, **style)


def draw_path(drive: Drive, axes: Axes, colour: str, size: float = 62.0) -> None:
    """Draw the true and the believed path and how it ended, a mark of ``size`` points^2."""
    axes.plot(
        *drive.pose_true[:, :2].T,
        color=colour,
        linewidth=2.4,
        alpha=0.6,  # the dashes of the same colour must show on it
        solid_capstyle="round",
        solid_joinstyle="round",
        zorder=5,
    )
    axes.plot(
        *drive.pose_estimated[:, :2].T,
        color=colour,
        linewidth=1.3,
        linestyle=DASHES,
        zorder=6,
    )
    x, y = (float(v) for v in drive.pose_true[-1, :2])
    _mark_end(drive, axes, x, y, colour, size)


def save_trajectories(drives: Sequence[Drive], path: Path | str, dpi: int = 120) -> None:
    """Write the picture of ``drives``; raises OSError where ``path`` cannot be written."""
    trajectories_figure(drives).savefig(path, dpi=dpi)


def _mark_end(drive: Drive, axes: Axes, x: float, y: float, colour: str, size: float) -> None:
    axes.scatter(
        float(x),
        float(y),
        s=size,
        marker=MARK[drive.record.outcome],
        color=colour,
        edgecolors=PAPER,
        linewidths=0.9,
        zorder=8,
        clip_on=False,
    )


def _name_methods(
    drives: Sequence[Drive], colours: dict[str, str], axes: Axes, map_height: float
) -> None:
    """Under the map a line for each drive: colour, name, how it ended."""
    for row, drive in enumerate(drives):
        colour = colours[drive.method]
        y = -(_GAP + row * _ROW) / map_height
        line = Line2D([0.0, 0.05], [y, y], color=colour, linewidth=2.2, clip_on=False)
        line.set_transform(axes.transAxes)
        axes.add_line(line)
        axes.text(
            0.065,
            y,
            shortened(f"{drive.method}: {drive.reason}", 9, 0.93 * (_COLUMN - _LEFT - _RIGHT)),
            transform=axes.transAxes,
            va="center",
            size=9,
            color=INK,
        )


def _draw_errors(
    drives: Sequence[Drive], colours: dict[str, str], position: Axes, angle: Axes
) -> None:
    for axes, name in ((position, "position_error"), (angle, "angle_error")):
        for drive in drives:
            colour, values = colours[drive.method], getattr(drive, name)
            axes.plot(drive.time, values, color=colour, linewidth=1.4, zorder=3)
            _mark_end(drive, axes, drive.time[-1], values[-1], colour, 34.0)
    last = max(float(drive.time[-1]) for drive in drives)
    for axes, limit, label in (
        (position, drives[0].lost_distance, "position\nerror (m)"),
        (angle, drives[0].lost_angle, "angle\nerror (rad)"),
    ):
        axes.axhline(limit, color=SLATE, linewidth=0.9, linestyle="--")
        axes.text(
            0.0, limit, " lost", color=SLATE, size=8, va="bottom", ha="left",
            transform=axes.get_yaxis_transform(),
        )  # fmt: skip
        axes.set_ylabel(label, size=9, color=INK)
        axes.set_xlim(0.0, 1.02 * last)
        axes.set_ylim(0.0, 1.06 * max(axes.dataLim.y1, 1.12 * limit))
        quiet(axes)
    position.tick_params(labelbottom=False)
    angle.set_xlabel("time (s)", size=9, color=INK)


def _legend(outcomes: set[str]) -> list[Any]:
    def mark(label: str, marker: str, **style: Any) -> Line2D:
        return Line2D([], [], linestyle="", marker=marker, label=label, **style)

    return [
        Line2D([], [], color=INK, linewidth=2.4, alpha=0.6, label="true path"),
        Line2D([], [], color=INK, linewidth=1.3, linestyle=DASHES, label="believed"),
        Line2D([], [], color=PERSON[""], linewidth=0.9, marker="o", markersize=3, label="people"),
        mark("start", "o", markerfacecolor=PAPER, markeredgecolor=INK, markersize=5.5),
        mark("goal", "*", color=GOAL, markersize=9),
        *(
            mark(OUTCOME_WORD[outcome], marker, color=INK, markersize=6)
            for outcome, marker in MARK.items()
            if outcome in outcomes
        ),
    ]


__all__ = [
    "METHODS",
    "draw_path",
    "draw_people_paths",
    "draw_trajectories",
    "quiet",
    "save_trajectories",
    "trajectories_figure",
]
