"""One moment of an episode: the map with all of the belief, and panels of what led there.

Below the map: how far the estimate is off over time with the limits of being lost, what each part
of the reward has paid so far, and how likely the policy took each action to be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Rectangle
from matplotlib.ticker import MaxNLocator

from lndrl.navigation import WorldSnapshot
from lndrl.view.palette import (
    BELIEF,
    BELIEF_DARK,
    BLUE,
    INK,
    OUTCOME,
    PAPER,
    SERIES,
    SLATE,
    WALL,
)
from lndrl.view.pictures.axes import quiet
from lndrl.view.pictures.fitting import shortened
from lndrl.view.pictures.world import world_figure
from lndrl.view.playing.course import Course, course_of, deviation_ellipse

WIDTH = 12.0
_PANELS, _ABOVE, _BELOW = 2.05, 0.34, 0.42
"""inches of the panels, of the titles above them and the words below"""
_LEFT, _GAP, _RIGHT = 0.62, 0.62, 0.14
_SHARES = (0.33, 0.37, 0.30)
LEAST_SHARE = 0.02
"""Of the weight, below which a second cluster is not worth a mark."""
_PROBABLE = LinearSegmentedColormap.from_list("probable", [PAPER, BLUE])
_HALO: list[patheffects.AbstractPathEffect] = [
    patheffects.withStroke(linewidth=2.5, foreground=PAPER)
]
LOST = OUTCOME["lost"]
_HANDLES = (
    Line2D([], [], color=BELIEF_DARK, linewidth=1.3, label="covariance, 2 σ"),
    Line2D(
        [], [], linestyle="", marker="D", markersize=6, markerfacecolor="none",
        markeredgecolor=BELIEF_DARK, markeredgewidth=1.6, label="second cluster",
    ),
)  # fmt: skip


def moment_figure(
    snapshots: Sequence[WorldSnapshot], k: int, close_up: bool = True, course: Course | None = None
) -> Figure:
    """Moment ``k`` of an episode; ``course`` is that of all ``snapshots``, where it is known."""
    course = course or course_of(snapshots)
    snapshot = snapshots[k]
    figure = world_figure(snapshot, WIDTH, close_up, _HANDLES)
    for axes in figure.axes:
        _draw_belief(snapshot, axes)
    places = _make_room(figure)
    _draw_error(course, k, snapshot, figure.add_axes(places[0]))
    _draw_parts(course, k, figure.add_axes(places[1]))
    _draw_actions(snapshot, figure.add_axes(places[2]))
    return figure


def _make_room(figure: Figure) -> list[tuple[float, float, float, float]]:
    """Make the figure higher, keep all of it at the top; returns places of panels below."""
    old = float(figure.get_figheight())
    added = _PANELS + _ABOVE + _BELOW
    height = old + added
    boxes = [axes.get_position().bounds for axes in figure.axes]
    figure.set_figheight(height)
    for axes, (x, y, w, h) in zip(figure.axes, boxes, strict=True):
        axes.set_position((x, (y * old + added) / height, w, h * old / height))
    for legend in figure.legends:
        legend.set_bbox_to_anchor((0.0, added / height, 1.0, old / height), figure.transFigure)
    room = WIDTH - _LEFT - _RIGHT - 2 * _GAP
    places, x = [], _LEFT
    for share in _SHARES:
        places.append((x / WIDTH, _BELOW / height, share * room / WIDTH, _PANELS / height))
        x += share * room + _GAP
    return places


def _draw_belief(snapshot: WorldSnapshot, axes: Axes) -> None:
    """The covariance as an ellipse, the second cluster, and where it got lost."""
    x, y = (float(v) for v in snapshot.pose_estimated[:2])
    long, short, angle = deviation_ellipse(snapshot.covariance)
    if long > 0.0:
        # Of the whole set, which need not be where its heaviest cluster is.
        axes.add_patch(
            Ellipse(
                (x, y), 2 * long, 2 * short, angle=math.degrees(angle), fill=False,
                edgecolor=BELIEF_DARK, linewidth=1.3, zorder=9,
            )
        )  # fmt: skip
    share, cx, cy = snapshot.clusters[1]
    if share >= LEAST_SHARE:
        axes.scatter(
            cx, cy, marker="D", s=46, facecolors="none", edgecolors=BELIEF_DARK, linewidths=1.6,
            zorder=10,
        )  # fmt: skip
        _say(axes, f"{share:.0%}", (cx, cy), BELIEF_DARK)
    if snapshot.outcome == "lost":
        at = (float(snapshot.pose_true[0]), float(snapshot.pose_true[1]))
        axes.scatter(*at, marker="x", s=150, color=LOST, linewidths=3.0, zorder=11)
        axes.plot([at[0], x], [at[1], y], color=LOST, linewidth=1.6, linestyle=":", zorder=10)
        _say(axes, "lost here", at, LOST)


def _say(axes: Axes, words: str, at: tuple[float, float], colour: str) -> None:
    said = axes.annotate(
        words, at, xytext=(8, -9), textcoords="offset points", size=8.5, color=colour,
        weight="bold", zorder=12, annotation_clip=True, va="top",
    )  # fmt: skip
    said.set_path_effects(_HALO)


def _title(axes: Axes, words: str, note: str = "") -> None:
    axes.set_title(words, loc="left", size=9.5, color=INK, weight="bold", pad=5)
    if note:
        axes.set_title(note, loc="right", size=8.5, color=INK, pad=5)


def _draw_error(course: Course, k: int, snapshot: WorldSnapshot, axes: Axes) -> None:
    """Position and angle error as shares of what is lost, which both then are at 1."""
    kinds = (
        ("position", course.position_error, snapshot.lost_distance, BLUE, "m"),
        ("angle", np.degrees(course.angle_error), math.degrees(snapshot.lost_angle), BELIEF, "°"),
    )
    words = []
    for name, values, limit, colour, unit in kinds:
        scale = limit if math.isfinite(limit) and limit > 0 else max(float(values.max()), 1e-9)
        shares = values / scale
        axes.plot(course.time, shares, color=colour, linewidth=1.0, alpha=0.3)
        axes.plot(course.time[: k + 1], shares[: k + 1], color=colour, linewidth=1.7, label=name)
        axes.plot(course.time[k], shares[k], "o", color=colour, markersize=4)
        digits = 2 if unit == "m" else 0
        space = " " if unit == "m" else ""
        words.append(f"{values[k]:.{digits}f} of {limit:.{digits}f}{space}{unit}")
    axes.axhline(1.0, color=LOST, linewidth=1.1, linestyle="--")
    axes.text(
        0.0, 1.0, " lost from here on", transform=axes.get_yaxis_transform(), size=8, color=LOST,
        va="bottom",
    )  # fmt: skip
    if course.lost_at is not None:
        axes.axvline(course.lost_at, color=LOST, linewidth=1.6)
        axes.annotate(
            f"lost at {course.lost_at:.1f} s", (course.lost_at, 1.0), textcoords="offset points",
            xycoords=("data", "axes fraction"), size=8.5, color=LOST, weight="bold", va="top",
            ha="right", xytext=(-4, -2),
        )  # fmt: skip
    highest = max(
        (course.position_error / max(snapshot.lost_distance, 1e-9)).max(),
        (course.angle_error / max(snapshot.lost_angle, 1e-9)).max(),
        1.0,
    )
    axes.set_ylim(0.0, 1.28 * float(highest))
    _over_time(axes, course)
    axes.set_ylabel("share of the limit", size=8.5, color=INK, labelpad=2)
    _title(axes, "pose error", ", ".join(words))
    axes.legend(
        loc="upper left", fontsize=8, frameon=False, ncols=2, labelcolor=INK, handlelength=1.2
    )


def _over_time(axes: Axes, course: Course) -> None:
    quiet(axes)
    axes.set_xlim(0.0, max(float(course.time[-1]), 1e-9))
    axes.set_xlabel("s", size=8.5, color=INK, labelpad=0)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(5))


def _draw_parts(course: Course, k: int, axes: Axes) -> None:
    """What each part has paid so far; its name and sum stand in its colour at the right."""
    for i, name in enumerate(course.part_names):
        colour = (*SERIES, WALL)[i % (len(SERIES) + 1)]
        paid = course.paid[:, i]
        axes.plot(course.time, paid, color=colour, linewidth=1.0, alpha=0.3)
        axes.plot(course.time[: k + 1], paid[: k + 1], color=colour, linewidth=1.7)
        axes.plot(course.time[k], paid[k], "o", color=colour, markersize=4)
        row = 0.95 - 0.9 * i / max(len(course.part_names) - 1, 1)
        style: dict[str, Any] = {
            "transform": axes.transAxes, "size": 8.5, "color": colour, "weight": "bold",
            "va": "center",
        }  # fmt: skip
        axes.text(1.02, row, shortened(name, 8.5, 0.8, "bold"), ha="left", **style)
        axes.text(1.49, row, f"{paid[k]:+.0f}", ha="right", **style)
    box = axes.get_position().bounds
    axes.set_position((box[0], box[1], box[2] * 0.68, box[3]))
    if len(course.part_names):
        _over_time(axes, course)
        _title(axes, "reward, summed", f"all parts {course.paid[k].sum():+.0f}")


def _draw_actions(snapshot: WorldSnapshot, axes: Axes) -> None:
    """Probabilities over the table of speeds and rates of turning; the action taken is framed."""
    speeds, rates = (np.unique(snapshot.actions[:, i]) for i in (0, 1))
    table = np.zeros((len(speeds), len(rates)))
    known = len(snapshot.probabilities) == len(snapshot.actions) > 0
    if known:
        row = np.searchsorted(speeds, snapshot.actions[:, 0])
        column = np.searchsorted(rates, snapshot.actions[:, 1])
        table[row, column] = snapshot.probabilities
    # Left on the picture is left of the robot: turning rates grow to the left.
    table, rates = table[:, ::-1], rates[::-1]
    if table.size:
        axes.imshow(table, origin="lower", cmap=_PROBABLE, vmin=0.0, vmax=1.0, aspect="auto")
    for (r, c), share in np.ndenumerate(table):
        if share >= 0.005:
            colour = PAPER if share > 0.5 else INK
            axes.text(c, r, f"{100 * share:.0f}", ha="center", va="center", size=8, color=colour)
    for edge in range(1, len(rates)):
        axes.axvline(edge - 0.5, color=SLATE, linewidth=0.4, alpha=0.5)
    for edge in range(1, len(speeds)):
        axes.axhline(edge - 0.5, color=SLATE, linewidth=0.4, alpha=0.5)
    if snapshot.action >= 0:
        v, w = snapshot.actions[snapshot.action]
        at = (float(np.argmin(np.abs(rates - w))) - 0.5, float(np.argmin(np.abs(speeds - v))) - 0.5)
        axes.add_patch(
            Rectangle(at, 1, 1, fill=False, edgecolor=BELIEF_DARK, linewidth=2.2, zorder=5)
        )
    axes.set_xticks(range(len(rates)), [f"{rate:.2g}" for rate in rates])
    axes.set_yticks(range(len(speeds)), [f"{speed:.2g}" for speed in speeds])
    axes.tick_params(colors=INK, labelsize=8, length=0)
    for spine in axes.spines.values():
        spine.set(color=SLATE, linewidth=0.8)
    axes.set_xlabel("turning (rad/s), left is left", size=8.5, color=INK, labelpad=1)
    axes.set_ylabel("m/s", size=8.5, color=INK, labelpad=1)
    note = "framed: taken" if known else "a rule: taken action alone"
    if not snapshot.steps:
        note = "none yet"
    _title(axes, "actions (%)" if known or not snapshot.steps else "actions", note)
