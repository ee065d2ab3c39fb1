"""What a recording says of the belief, as a table and a picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.table import Table

from lndrl.robot.bags import Replay
from lndrl.view.palette import BAD, BELIEF, BELIEF_DARK, GOAL, INK, PAPER, SLATE, TRUTH, WALL
from lndrl.view.pictures.axes import quiet
from lndrl.view.text import MISSING, duration, number, percent

_WIDTH, _CHART, _GAP = 8.0, 1.3, 0.5  # inches
_MARGIN = 1.0
"""m of map that is shown around what was driven."""
_CARRIED = 1.0
"""m from one belief to the next that nobody drives."""


def replay_table(title: str, summary: Mapping[str, Any]) -> Table:
    """``Replay.summary`` for people."""
    table = Table(title=title, title_justify="left")
    table.add_column("what")
    table.add_column("value", justify="right")
    reference = summary["reference"]
    rows = [
        ("recorded", duration(summary["seconds"])),
        ("scans, and beliefs that came of them", f"{summary['scans']:,}, {summary['beliefs']:,}"),
        ("width of the belief, mean and 95 % (m)",
         _two(summary["deviation_mean"], summary["deviation_p95"])),
        ("share of the scan that the map explains", percent(summary["agreement_mean"])),
        ("particles that matter, median", number(summary["effective_median"])),
    ]  # fmt: skip
    if reference is not None:
        rows += [
            (f"from {reference}, mean and 95 % (m)",
             _two(summary["off_mean"], summary["off_p95"])),
            (f"from {reference}, at the end (m)", number(summary["off_end"])),
            (f"from {reference}, heading, mean (rad)", number(summary["turned_mean"])),
        ]  # fmt: skip
    rows += [
        ("decisions, arrivals", f"{summary['decisions']:,}, {summary['arrivals']}"),
        ("decisions that the guard would hold back", percent(summary["guarded"])),
        ("same command as recorded", percent(summary["same_commands"])),
    ]
    for words, value in rows:
        table.add_row(words, value)
    for reason, seconds in summary["standing"].items():
        table.add_row(f"would stand: {reason}", f"{seconds:.1f} s")
    return table


def _two(one: float | None, other: float | None) -> str:
    return MISSING if one is None else f"{number(one)}, {number(other)}"


def replay_figure(result: Replay, title: str) -> Figure:
    """The map with the way of the belief, and over time its width and how far it was off."""
    poses = np.array([each.pose for each in result.moments]).reshape(-1, 3)
    low, high = _extent(result, poses)
    across, up = np.maximum(high - low, 0.5)
    inner = _WIDTH - 1.0
    tall = float(np.clip(inner * up / across, 2.0, 9.0))
    height = tall + 2 * _CHART + 3 * _GAP + 0.4
    figure = Figure(figsize=(_WIDTH, height), facecolor=PAPER)
    FigureCanvasAgg(figure)

    def place(bottom: float, size: float) -> Axes:
        return figure.add_axes((0.75 / _WIDTH, bottom / height, inner / _WIDTH, size / height))

    floor = place(2 * _CHART + 3 * _GAP, tall)
    _draw_map(floor, result, poses, (low, high))
    floor.set_title(title, loc="left", size=11, color=INK)
    _draw_widths(place(_CHART + 2 * _GAP, _CHART), result)
    _draw_agreement(place(_GAP, _CHART), result)
    return figure


def save_replay(result: Replay, title: str, path: Path) -> None:
    """The picture as a file. Raises OSError where it cannot be written."""
    replay_figure(result, title).savefig(path, dpi=130)


def _extent(result: Replay, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is shown: what was driven, or the whole map where nothing was."""
    points = [poses[:, :2], result.reference[:, 1:3]]
    if result.goal is not None:
        points.append(result.goal[None])
    driven = np.concatenate(points)
    if len(driven):
        return driven.min(axis=0) - _MARGIN, driven.max(axis=0) + _MARGIN
    if result.map is not None:
        origin = np.array(result.map.grid.origin)
        return origin, origin + np.array(result.map.grid.size)
    return np.zeros(2), np.ones(2)


def _draw_map(
    axes: Axes, result: Replay, poses: np.ndarray, shown: tuple[np.ndarray, np.ndarray]
) -> None:
    if result.map is not None:
        grid = result.map.grid
        (x, y), (width, height) = grid.origin, grid.size
        image = np.ones((*grid.shape, 4))
        image[grid.mapped] = _rgba(WALL)
        if grid.unknown is not None:
            image[grid.unknown] = _rgba(SLATE, 0.25)
        extent = (x, x + width, y, y + height)
        axes.imshow(image, origin="lower", extent=extent, interpolation="nearest")
    if len(result.reference):
        x, y = _broken(result.reference[:, 1:3]).T
        axes.plot(x, y, color=TRUTH, linewidth=1.6, label=result.reference_topic)
    if len(poses):
        x, y = _broken(poses[:, :2]).T
        axes.plot(x, y, color=BELIEF_DARK, linewidth=1.2, label="belief")
        axes.plot(*poses[0, :2], "o", color=PAPER, markeredgecolor=INK, markersize=6)
        standing = np.array([bool(each.reasons) for each in result.moments])
        axes.plot(*poses[standing, :2].T, ".", color=BAD, markersize=3, label="would stand")
    if result.goal is not None:
        axes.plot(*result.goal, "*", color=GOAL, markersize=12, label="goal")
    (left, bottom), (right, top) = shown
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    axes.tick_params(colors=INK, labelsize=8.5)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(fontsize=8.5, loc="upper right", framealpha=0.9)


def _broken(points: np.ndarray) -> np.ndarray:
    """``points`` (n, 2) with a gap where a robot was carried."""
    carried = np.flatnonzero(np.hypot(*np.diff(points, axis=0).T) > _CARRIED) + 1
    return np.insert(points.astype(float), carried, np.nan, axis=0)


def _draw_widths(axes: Axes, result: Replay) -> None:
    time = result.column("time")
    axes.plot(time, result.column("deviation"), color=BELIEF, linewidth=1.2, label="width")
    if result.reference_topic:
        label = f"from {result.reference_topic}"
        axes.plot(time, result.column("off"), color=TRUTH, linewidth=1.2, label=label)
    axes.set_ylabel("m", size=9, color=INK)
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=8.5, loc="upper right", framealpha=0.9)
    quiet(axes)


def _draw_agreement(axes: Axes, result: Replay) -> None:
    time = result.column("time")
    axes.plot(time, 100.0 * result.column("agreement"), color=BELIEF_DARK, linewidth=1.0)
    axes.set_ylabel("% explained", size=9, color=INK)
    axes.set_xlabel("s", size=9, color=INK)
    axes.set_ylim(0.0, 100.0)
    quiet(axes)


def _rgba(colour: str, alpha: float = 1.0) -> tuple[float, float, float, float]:
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue, alpha
