"""Drawings of places: walls, where the robot starts and goes, where people walk.

Green boxes are the robot's regions, a dashed line joins the two of a task. Pink lines are the
people's routes, their arrows point along them. One episode's start is drawn into it, so that
people, robot and scan show how large things are. Axes count metres in the frame of the map.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Rectangle

from lndrl.config import LocalizationConfig, RunConfig
from lndrl.localization import LikelihoodMap
from lndrl.navigation import Navigation, WorldSnapshot
from lndrl.scenario import Box, Route
from lndrl.view.palette import GOAL, INK, LASER, LEG, PAPER, PERSON, SLATE, TRUTH
from lndrl.view.pictures.fitting import add_legend, text_width, wrapped
from lndrl.view.pictures.world import draw_floor, draw_laser, draw_people, draw_robot
from lndrl.world import Place

_LONGEST_SIDE = 9.0  # inches
_MARGIN = 0.12  # inches
_TICKS, _HEAD, _LEGEND = 0.35, 0.42, 0.40  # inches
_NARROWEST = 3.4  # inches; a narrow place stands in the middle of them
_TITLE, _LINE = 11, 0.21  # points, inches from line to line
_LOOKS = 20
_END = "-|>"


def sample_start(place: Place, seed: int = 0, episode: int = 0) -> WorldSnapshot:
    """The start of an episode in ``place``: somebody in every picture to compare sizes with."""
    config = RunConfig(
        seed=seed, scenario=place.scenario, localization=LocalizationConfig(kind="perfect")
    )
    field = LikelihoodMap.build(place.grid, config.localization, config.world.laser)
    world = Navigation(place, field, config, world_id=0)
    for number in range(episode, episode + _LOOKS):
        world.reset(number)
        snapshot = world.snapshot()
        ahead = snapshot.goal - snapshot.pose_true[:2]
        turn = np.arctan2(ahead[1], ahead[0]) - snapshot.pose_true[2]
        if np.cos(turn) > 0.8:  # a robot that looks where it is asked to go tells more
            break
    return snapshot


def draw_scenario(place: Place, snapshot: WorldSnapshot, axes: Axes) -> None:
    """Draw ``place`` with the people, robot and scan of ``snapshot`` into ``axes``."""
    draw_floor(snapshot, axes)
    draw_laser(snapshot, axes)
    for task in place.scenario.robot:
        for box in (task.start, task.goal):
            axes.add_patch(region(box))
        ends = np.array([_middle(task.start), _middle(task.goal)])
        axes.plot(*ends.T, color=GOAL, linewidth=1.1, linestyle=(0, (5, 3)), alpha=0.8, zorder=3)
    for route in place.scenario.pedestrians.routes:
        _draw_route(route, axes)
    draw_people(snapshot, axes)
    width, height = place.grid.size
    draw_robot(snapshot, axes, max(snapshot.robot_radius, 0.009 * max(width, height)))
    axes.set(xlim=(0, width), ylim=(0, height), aspect="equal")
    mark_metres(place, axes)


def scenario_figure(place: Place, title: str = "", episode: int = 0) -> Figure:
    """A figure of ``place`` with title and legend; the place's longer side is 9 inches."""
    snapshot = sample_start(place, episode=episode)
    width, height = place.grid.size
    scale = _LONGEST_SIDE / max(width, height * 1.2)
    across, up = width * scale, height * scale
    wide = max(across + _TICKS + 2 * _MARGIN, _NARROWEST)
    figure = Figure(figsize=(wide, _LONGEST_SIDE), facecolor=PAPER)
    FigureCanvasAgg(figure)
    style = {"fontsize": 8.5, "labelcolor": INK, "handletextpad": 0.6, "columnspacing": 1.6}
    legend = max(_LEGEND, add_legend(figure, _legend(), 5, **style))
    left = max(_MARGIN + _TICKS, 0.5 * (wide - across))
    title = title or place.scenario.name
    beside = left + text_width(title, _TITLE) > wide - _MARGIN
    lines = wrapped(title, _TITLE, wide - 2 * _MARGIN) if beside else title
    head = _HEAD + _LINE * lines.count("\n")
    tall = up + _TICKS + head + legend
    figure.set_size_inches(wide, tall)
    axes = figure.add_axes((left / wide, (legend + _TICKS) / tall, across / wide, up / tall))
    draw_scenario(place, snapshot, axes)
    words = axes.set_title(lines, loc="left", size=_TITLE, color=INK, pad=7)
    if beside:
        words.set_x((_MARGIN - left) / across)
    return figure


def save_scenario(place: Place, path: Path | str, title: str = "") -> None:
    """Write a picture of ``place``; raises OSError where ``path`` cannot be written."""
    save_small(scenario_figure(place, title), path)


def save_small(figure: Figure, path: Path | str, shades: bool = False) -> None:
    """Write ``figure``, whose colours are few but for ``shades`` of one; raises OSError where
    ``path`` cannot be written.
    """
    # A palette of 128 colours: half the bytes, and no eye sees it. Shades take most of a palette
    # that goes by areas, and small marks lose their colour: theirs goes by the range of colours.
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())  # type: ignore[attr-defined]
    from PIL import Image

    picture = Image.fromarray(pixels[..., :3])
    method = Image.Quantize.MAXCOVERAGE if shades else None
    picture.quantize(256 if shades else 128, method=method, dither=Image.Dither.NONE).save(
        path, optimize=True
    )


def region(box: Box) -> Rectangle:
    """A box that the robot starts or arrives in."""
    x0, y0, x1, y1 = box
    return Rectangle(
        (x0, y0),
        x1 - x0,
        y1 - y0,
        facecolor=GOAL,
        edgecolor=GOAL,
        alpha=0.28,
        linewidth=1,
        zorder=2,
    )


def _draw_route(route: Route, axes: Axes) -> None:
    """A line through the waypoints; arrows at the ends that people walk to."""
    points = np.array([_middle(route.start), *route.via, _middle(route.goal)])
    style: dict[str, Any] = {"color": PERSON[""], "alpha": 0.65, "zorder": 2.5}
    far = np.hypot(*np.diff(points, axis=0).T) > 0.3  # arrows need a leg to point along
    points = points[np.concatenate([far | ~far.any(), [True]])]
    axes.plot(*points.T, linewidth=1.0, **style)
    ends = [(points[-2], points[-1])]
    if route.both_ways:
        ends.append((points[1], points[0]))
    for before, end in ends:
        step = (end - before) / max(float(np.hypot(*(end - before))), 1e-9)
        axes.add_patch(
            FancyArrowPatch(
                tuple(end - 0.4 * step),
                tuple(end),
                arrowstyle=_END,
                mutation_scale=9,
                shrinkA=0,
                shrinkB=0,
                linewidth=1.0,
                **style,
            )
        )


def mark_metres(place: Place, axes: Axes) -> None:
    """Round numbers of metres in the map's frame along the edges."""
    step = next(s for s in (1, 2, 5, 10, 20, 50, 100) if max(place.grid.size) / s <= 14)
    for axis, origin, length in (
        (axes.xaxis, place.map_origin[0], place.grid.size[0]),
        (axes.yaxis, place.map_origin[1], place.grid.size[1]),
    ):
        marks = np.arange(np.ceil(origin / step) * step, origin + length + 1e-6, step)
        axis.set_ticks(list(marks - origin), [f"{mark + 0.0:g}" for mark in marks])
    axes.tick_params(colors=SLATE, labelsize=8, length=3, color=SLATE)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _middle(box: Box) -> tuple[float, float]:
    return (box[0] + box[2]) / 2, (box[1] + box[3]) / 2


def _legend() -> list[Any]:
    dashes = (0, (5, 3))
    return [
        Line2D([], [], color=TRUTH, marker="o", linestyle="", markersize=6, label="robot"),
        Patch(facecolor=LASER, alpha=0.4, label="what its laser sees"),
        Patch(facecolor=GOAL, alpha=0.35, label="starts and goals"),
        Line2D([], [], color=GOAL, linestyle=dashes, label="a task, both ways"),
        Line2D([], [], color=PERSON[""], marker="o", markerfacecolor=LEG, label="people, routes"),
    ]
