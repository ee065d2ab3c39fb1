"""Drawings of a world and of what the robot believes about it.

Blue is the truth (robot, path), orange the belief (particles, estimated pose and path), pale blue
what the laser sees, pink the people, green the goal. Metres in the map frame, x right and y up.
Figures are made directly, without pyplot, so nothing global changes and threads may draw.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colors, patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon, Rectangle
from numpy.typing import NDArray

from lndrl.maps.grid import OccupancyGrid
from lndrl.navigation.snapshot import WorldSnapshot
from lndrl.view.palette import (
    BELIEF,
    BELIEF_DARK,
    ECHO,
    FLOOR,
    GOAL,
    INK,
    LASER,
    LEG,
    OUTCOME,
    OUTCOME_WORD,
    PAPER,
    PERSON,
    SLATE,
    TRUTH,
    WALL,
)
from lndrl.view.pictures.fitting import add_legend, shortened, text_width

View = tuple[float, float, float, float]
"""x_min, x_max, y_min, y_max (m)."""

CLOSE_UP = 9.0
"""m, side of the square around the robot."""
ARROW = 1.5
"""s, a person's arrow ends where they will be after so long."""
LEGEND_STYLE: dict[str, Any] = {
    "fontsize": 9,
    "labelcolor": INK,
    "handletextpad": 0.5,
    "columnspacing": 1.8,
}
TICKED_PARTICLES = 600
"""Particles beyond this many are thinned: more ticks only blacken the picture."""
_TITLE, _TITLE_GAP = 11, 0.15  # points, inches
_HALO: list[patheffects.AbstractPathEffect] = [
    patheffects.withStroke(linewidth=2.5, foreground=PAPER)
]


def draw_world(
    snapshot: WorldSnapshot, axes: Axes, view: View | None = None, title: bool = True
) -> None:
    """Draw ``snapshot`` into ``axes``, all of the place or only ``view``.

    The axes lose ticks and frame and get equal aspect; a bar says how long metres are.
    """
    width, height = snapshot.size
    left, right, bottom, top = view or (0.0, width, 0.0, height)
    draw_floor(snapshot, axes)
    draw_laser(snapshot, axes)
    draw_goal(snapshot, axes)
    _draw_paths(snapshot, axes)
    draw_people(snapshot, axes)
    # From afar ticks would only make the cloud look larger than it is.
    _draw_particles(snapshot, axes, tick=0.15 if right - left < 15.0 else 0.0)
    emphasis = max(1.0, 0.009 * (right - left) / snapshot.robot_radius)
    draw_robot(snapshot, axes, snapshot.robot_radius * emphasis)
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set(visible=view is not None, color=SLATE, linewidth=0.8)
    draw_scale(axes, (left, right, bottom, top))
    if title:
        _draw_title(snapshot, axes)


def close_view(snapshot: WorldSnapshot, side: float = CLOSE_UP) -> View:
    """A square of ``side`` m around the robot, moved so that it stays in the place."""
    width, height = snapshot.size
    x, y = (float(v) for v in snapshot.pose_true[:2])
    left = min(max(x - side / 2, 0.0), max(width - side, 0.0))
    bottom = min(max(y - side / 2, 0.0), max(height - side, 0.0))
    return left, left + side, bottom, bottom + side


def scan_points(snapshot: WorldSnapshot) -> NDArray[np.float64]:
    """End of every beam (beams, 2) in the map frame, seen from the true pose."""
    return _beam_ends(snapshot, np.asarray(snapshot.scan, np.float64))


def _beam_ends(snapshot: WorldSnapshot, ranges: NDArray[np.float64]) -> NDArray[np.float64]:
    increment = snapshot.field_of_view / len(ranges)
    bearing = -0.5 * snapshot.field_of_view + increment * np.arange(len(ranges))
    angle = snapshot.pose_true[2] + bearing
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(snapshot.pose_true[:2] + ranges[:, None] * unit, np.float64)


def draw_floor(snapshot: WorldSnapshot | OccupancyGrid, axes: Axes) -> None:
    """Draw floor and walls."""
    rows, columns = snapshot.occupied.shape
    x, y = snapshot.origin
    extent = (x, x + columns * snapshot.resolution, y, y + rows * snapshot.resolution)
    axes.imshow(
        snapshot.occupied,
        origin="lower",
        extent=extent,
        cmap=colors.ListedColormap([FLOOR, WALL]),
        vmin=0,
        vmax=1,
        interpolation="nearest",
        zorder=0,
    )


def draw_laser(snapshot: WorldSnapshot, axes: Axes) -> None:
    """Draw the scan: a fan of what is seen and a dot for every echo."""
    if not len(snapshot.scan):
        return
    points = scan_points(snapshot)
    # The fan shows what is seen, so single false beams are smoothed away; the dots keep them.
    window = np.lib.stride_tricks.sliding_window_view(np.pad(snapshot.scan, 3, mode="edge"), 7)
    smooth = np.median(window, axis=1).astype(np.float64)
    fan = np.vstack([snapshot.pose_true[:2], _beam_ends(snapshot, smooth)])
    axes.add_patch(Polygon(fan, closed=True, facecolor=LASER, alpha=0.16, linewidth=0, zorder=1))
    echo = points[snapshot.scan < snapshot.range_max * 0.9999]
    axes.scatter(echo[:, 0], echo[:, 1], s=2.2, color=ECHO, linewidths=0, zorder=4)


def draw_goal(snapshot: WorldSnapshot, axes: Axes) -> None:
    """Draw the goal and the disc in which it counts as reached."""
    centre = (float(snapshot.goal[0]), float(snapshot.goal[1]))
    radius = snapshot.arrive_distance
    axes.add_patch(Circle(centre, radius, facecolor=GOAL, alpha=0.18, linewidth=0, zorder=2))
    axes.add_patch(
        Circle(centre, radius, fill=False, edgecolor=GOAL, linewidth=1.6, linestyle="-", zorder=5)
    )
    axes.scatter(*centre, marker="*", s=70, color=GOAL, edgecolors=PAPER, linewidths=0.6, zorder=5)


def _draw_paths(snapshot: WorldSnapshot, axes: Axes) -> None:
    if len(snapshot.path_estimated) > 1:
        axes.plot(
            *snapshot.path_estimated.T,
            color=BELIEF_DARK,
            linewidth=1.6,
            linestyle=(0, (3, 1.6)),
            zorder=6,
        )
    if len(snapshot.path) > 1:
        axes.plot(
            *snapshot.path.T,
            color=TRUTH,
            linewidth=1.9,
            solid_capstyle="round",
            solid_joinstyle="round",
            zorder=5,
        )
    x, y = (float(v) for v in snapshot.start_pose[:2])
    axes.scatter(x, y, s=26, facecolors=PAPER, edgecolors=TRUTH, linewidths=1.4, zorder=6)


def draw_people(snapshot: WorldSnapshot, axes: Axes) -> None:
    """Draw everybody with legs and an arrow to where they will be soon."""
    position = np.asarray(snapshot.pedestrian_position, np.float64)
    if not len(position):
        return
    models = getattr(snapshot, "pedestrian_model", None)
    names = [str(model) for model in models] if models is not None else [""] * len(position)
    fill = [PERSON.get(name, PERSON[""]) for name in names]
    axes.add_collection(
        _discs(position, snapshot.pedestrian_radius, axes, facecolors=fill, alpha=0.38, zorder=3)
    )
    axes.add_collection(
        _discs(
            position,
            snapshot.pedestrian_radius,
            axes,
            facecolors="none",
            edgecolors=fill,
            linewidths=1.1,
            zorder=3,
        )
    )
    legs = np.asarray(snapshot.leg_position, np.float64)
    if len(legs):
        axes.add_collection(
            _discs(legs, snapshot.leg_radius, axes, facecolors=LEG, linewidths=0, zorder=4)
        )
    velocity = np.asarray(snapshot.pedestrian_velocity, np.float64)
    moving = np.hypot(velocity[:, 0], velocity[:, 1]) > 0.05
    if moving.any():
        axes.quiver(
            *position[moving].T,
            *(ARROW * velocity[moving]).T,
            angles="xy",
            scale_units="xy",
            scale=1,
            units="xy",
            width=0.05,
            headwidth=4.0,
            headlength=4.0,
            headaxislength=3.6,
            color=LEG,
            zorder=4,
        )


def _discs(centres: NDArray[np.float64], radius: float, axes: Axes, **style: Any) -> Any:
    """Discs of ``radius`` m around ``centres`` (n, 2)."""
    size = np.full(len(centres), 2 * radius)
    return EllipseCollection(
        size,
        size,
        np.zeros(len(centres)),
        units="xy",
        offsets=centres,
        offset_transform=axes.transData,
        **style,
    )


def _draw_particles(snapshot: WorldSnapshot, axes: Axes, tick: float) -> None:
    particles = np.asarray(snapshot.particles, np.float64)
    if not len(particles):
        return
    every = max(1, math.ceil(len(particles) / TICKED_PARTICLES))
    weights = np.asarray(snapshot.weights) * len(particles)
    size = 3.2 * np.clip(weights, 0.2, 5.0)[::every] if len(weights) else 3.2
    particles = particles[::every]
    alpha = min(0.8, max(0.3, 150 / len(particles)))
    start = particles[:, :2]
    if tick > 0:
        ahead = np.stack([np.cos(particles[:, 2]), np.sin(particles[:, 2])], axis=1)
        ticks = list(np.stack([start, start + tick * ahead], axis=1))
        axes.add_collection(
            LineCollection(ticks, colors=[BELIEF], alpha=alpha, linewidths=0.8, zorder=7)
        )
    axes.scatter(
        start[:, 0], start[:, 1], s=size, color=BELIEF, alpha=alpha, linewidths=0, zorder=7
    )


def draw_robot(snapshot: WorldSnapshot, axes: Axes, radius: float) -> None:
    """Draw the robot with ``radius`` m, true and believed."""
    for pose, colour, solid in (
        (snapshot.pose_true, TRUTH, True),
        (snapshot.pose_estimated, BELIEF_DARK, False),
    ):
        x, y, yaw = (float(v) for v in pose)
        style: dict[str, Any] = {"facecolor": colour} if solid else {"fill": False}
        edge = PAPER if solid else colour
        body = Circle((x, y), radius, edgecolor=edge, linewidth=0.8 if solid else 1.7, **style)
        body.set(zorder=8 if solid else 9)
        if not solid:
            body.set_path_effects(_HALO)
        axes.add_patch(body)
        reach = radius * 2.1
        nose = axes.plot(
            [x + (0 if solid else radius) * math.cos(yaw), x + reach * math.cos(yaw)],
            [y + (0 if solid else radius) * math.sin(yaw), y + reach * math.sin(yaw)],
            color=colour,
            linewidth=2.0 if solid else 1.7,
            solid_capstyle="round",
            zorder=8 if solid else 9,
        )[0]
        nose.set_path_effects(_HALO)


def draw_scale(axes: Axes, view: View) -> None:
    """A bar of a round length at the lower left corner."""
    left, right, bottom, top = view
    length = next(n for n in (50, 20, 10, 5, 2, 1) if n <= max(0.25 * (right - left), 1))
    x, y = left + 0.025 * (right - left), bottom + 0.04 * (top - bottom)
    thick = 0.005 * (top - bottom)
    for i, colour in enumerate((INK, PAPER)):
        axes.add_patch(
            Rectangle(
                (x + i * length / 2, y),
                length / 2,
                2 * thick,
                facecolor=colour,
                edgecolor=INK,
                linewidth=0.8,
                zorder=10,
            )
        )
    words = axes.text(
        x + length / 2, y + 4 * thick, f"{length} m", ha="center", va="bottom", color=INK, size=8
    )
    words.set(zorder=10, path_effects=_HALO)


def _draw_title(snapshot: WorldSnapshot, axes: Axes) -> None:
    """Place and time on the left, the outcome on the right, or behind where there is no room."""
    word = OUTCOME_WORD.get(snapshot.outcome, snapshot.outcome)
    figure = axes.get_figure(root=True)
    assert figure is not None
    wide, box = figure.get_figwidth(), axes.get_position()
    outcome = _TITLE_GAP + text_width(word, _TITLE, "bold") if word else 0.0
    room = wide * (1.0 - box.x0) - _TITLE_GAP - outcome
    time = f"   {snapshot.time:.1f} s"
    title = shortened(snapshot.scenario, _TITLE, room - text_width(time, _TITLE)) + time
    axes.set_title(title, loc="left", size=_TITLE, color=INK, pad=6)
    if word:
        colour = OUTCOME.get(snapshot.outcome, INK)
        style: dict[str, Any] = {"size": _TITLE, "color": colour, "weight": "bold", "pad": 6}
        end = axes.set_title(word, loc="right", **style)
        if text_width(title, _TITLE) + outcome > wide * box.width:
            end.set(ha="left", x=(text_width(title, _TITLE) + _TITLE_GAP) / (wide * box.width))


def legend_handles() -> list[Any]:
    """One entry for each thing that a drawing shows."""

    def dot(label: str, colour: str, **style: Any) -> Line2D:
        return Line2D([], [], linestyle="", marker="o", color=colour, label=label, **style)

    return [
        Line2D([], [], color=TRUTH, marker="o", markersize=6, linewidth=1.9, label="robot"),
        Line2D(
            [],
            [],
            color=BELIEF_DARK,
            marker="o",
            markersize=6,
            markerfacecolor="none",
            linestyle=(0, (3, 1.6)),
            linewidth=1.6,
            label="where it believes to be",
        ),
        dot("particles", BELIEF, markersize=2.5),
        dot("laser", LASER, markersize=5),
        dot("people", PERSON[""], markersize=8, alpha=0.6),
        Line2D([], [], linestyle="", marker="*", markersize=9, color=GOAL, label="goal"),
    ]


def world_figure(
    snapshot: WorldSnapshot,
    width: float = 12.0,
    close_up: bool = True,
    more: Sequence[Any] = (),
) -> Figure:
    """A figure ``width`` inches wide: the place, a close view of the robot, a legend.

    ``more``: entries of the legend beside ``legend_handles``, for what is drawn over it.
    """
    place_width, place_height = snapshot.size
    ratio = place_height / place_width
    legend, head, gap = 0.42, 0.36, 0.12
    margin = 0.1
    room = width - 2 * margin
    # Both panels share one height: room = height / ratio + gap + height.
    map_height = (room - gap) / (1 / ratio + 1) if close_up else room * ratio
    map_height = min(map_height, width)  # of a tall place alone
    height = map_height + legend + head
    figure = Figure(figsize=(width, height), facecolor=PAPER)
    FigureCanvasAgg(figure)
    map_width = map_height / ratio
    box = (margin / width, legend / height, map_width / width, map_height / height)
    draw_world(snapshot, figure.add_axes(box))
    if close_up:
        x = (margin + map_width + gap) / width
        near = figure.add_axes((x, legend / height, map_height / width, map_height / height))
        side = min(CLOSE_UP, place_width, place_height)
        draw_world(snapshot, near, close_view(snapshot, side), title=False)
        _frame_view(figure.axes[0], close_view(snapshot, side))
    handles = [*legend_handles(), *more]
    add_legend(figure, handles, len(handles), **LEGEND_STYLE)
    return figure


def _frame_view(axes: Axes, view: View) -> None:
    left, right, bottom, top = view
    axes.add_patch(
        Rectangle(
            (left, bottom),
            right - left,
            top - bottom,
            fill=False,
            edgecolor=SLATE,
            linewidth=0.9,
            linestyle=(0, (4, 3)),
            zorder=9,
        )
    )


def save_png(
    snapshot: WorldSnapshot, path: Path | str, close_up: bool = True, dpi: int = 130
) -> None:
    """Write a picture of ``snapshot``; raises OSError where ``path`` cannot be written."""
    world_figure(snapshot, close_up=close_up).savefig(path, dpi=dpi)


__all__ = ["close_view", "draw_world", "legend_handles", "save_png", "scan_points", "world_figure"]
