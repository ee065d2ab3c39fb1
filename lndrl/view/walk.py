"""A walk in the terminal: the part of the world around the robot, two pixels in a character."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from lndrl.navigation.snapshot import WorldSnapshot
from lndrl.view.palette import BELIEF, ECHO, FLOOR, GOAL, PERSON, SLATE, TRUTH, WALL
from lndrl.view.text import styled

METRES = 0.2
"""m that a pixel is wide; a character is one pixel wide and two high."""
FINEST = 0.05
"""m of a pixel where a small place is drawn larger."""

_FLOOR, _WALL, _PATH, _ECHO, _CLOUD, _GOAL, _PERSON, _BELIEF, _ROBOT, _LOST = range(10)
_PARTICLE = "#F5CF85"
LOST_MARK = "#A0006D"
"""Darker than people, so that it stands out between them."""
_COLOURS = (*(FLOOR, WALL, SLATE, ECHO, _PARTICLE, GOAL, PERSON[""], BELIEF, TRUTH, LOST_MARK),)
_GLYPHS = " #.'*GoeRX"
LEGEND = (("robot", _ROBOT), ("where it believes to be", _BELIEF), ("people", _PERSON),
          ("goal", _GOAL), ("laser", _ECHO))  # fmt: skip
CLOUD_LEGEND = (LEGEND[0], ("belief", _BELIEF), ("particles", _CLOUD), *LEGEND[2:])


def walk_picture(
    snapshot: WorldSnapshot, columns: int, rows: int, colours: bool = True, cloud: bool = False
) -> Text:
    """``snapshot`` around the robot in at most ``rows`` lines of at most ``columns`` characters.

    Colours fill half characters; without them each character is the letter of the most important
    thing in it, as in the legend. A goal out of sight stands at the edge, in its direction. With
    the ``cloud`` of particles and, once it is lost, a cross where that happened; a place that would
    leave room is then drawn larger.
    """
    columns, rows = max(columns, 1), max(rows, 1)
    metres = METRES
    if cloud:
        width, height = snapshot.size
        finest = max(width / columns, height / (2 * rows), FINEST, snapshot.resolution)
        metres = min(finest, METRES)
    pixels = _pixels(snapshot, columns, rows, cloud, metres)
    if colours:
        return half_blocks(pixels, _COLOURS)
    upper, lower = pixels[0::2], pixels[1::2]
    picture = Text(no_wrap=True)
    for r in range(len(upper)):
        if r:
            picture.append("\n")
        picture.append("".join(_GLYPHS[code] for code in np.maximum(upper[r], lower[r])))
    return picture


def half_blocks(pixels: NDArray[np.uint8], colours: Sequence[str]) -> Text:
    """``pixels`` (2 * lines, characters), the highest y first, each one of ``colours``."""
    picture = Text(no_wrap=True)
    for r, (upper, lower) in enumerate(zip(pixels[0::2], pixels[1::2], strict=True)):
        if r:
            picture.append("\n")
        _append_row(picture, upper, lower, colours)
    return picture


def walk_legend(colours: bool = True, cloud: bool = False) -> Text:
    """What the colours (or letters) of ``walk_picture`` mean, in one line."""
    legend = Text(no_wrap=True)
    for word, code in CLOUD_LEGEND if cloud else LEGEND:
        sign = styled("■ ", _COLOURS[code]) if colours else Text(f"{_GLYPHS[code]} ")
        legend.append_text(sign).append(f"{word}   ")
    legend.rstrip()
    return legend


def walk_words(snapshot: WorldSnapshot) -> str:
    """How the walk stands at this moment, in words of at most 80 characters."""
    to_goal = np.hypot(*(snapshot.goal - snapshot.pose_true[:2]))
    off = np.hypot(*(snapshot.pose_estimated[:2] - snapshot.pose_true[:2]))
    near = np.linalg.norm(snapshot.pedestrian_position - snapshot.pose_true[:2], axis=1)
    people = int((near < 3.0).sum())
    noun = "person" if people == 1 else "people"
    return (
        f"{snapshot.time:5.1f} s, {to_goal:4.1f} m to the goal, {people} {noun} within 3 m, "
        f"belief {off:.2f} m off"
    )


def _append_row(
    picture: Text, upper: NDArray[np.uint8], lower: NDArray[np.uint8], colours: Sequence[str]
) -> None:
    """A line of half blocks; neighbours of the same two colours share one style."""
    pairs = upper.astype(int) * len(colours) + lower
    edges = np.flatnonzero(np.diff(pairs)) + 1
    for first, last in zip([0, *edges], [*edges, len(pairs)], strict=True):
        style = f"{colours[upper[first]]} on {colours[lower[first]]}"
        picture.append("▀" * int(last - first), style=style)


def _pixels(
    snapshot: WorldSnapshot, columns: int, rows: int, cloud: bool = False, metres: float = METRES
) -> NDArray[np.uint8]:
    """What is where, (2 * lines, characters), the highest y first; 0 is floor."""
    size = np.array(snapshot.size)
    shape = np.minimum(np.ceil(size / metres - 1e-9).astype(int), (columns, 2 * rows))
    shape[1] += shape[1] % 2
    span = shape * metres
    low = np.clip(snapshot.pose_true[:2] - span / 2, 0.0, np.maximum(size - span, 0.0))
    drawn = np.zeros((shape[1], shape[0]), np.uint8)

    def dots(points: NDArray[np.float64], code: int) -> None:
        index = np.floor((points.reshape(-1, 2) - low) / metres).astype(int)
        index = index[((index >= 0) & (index < shape)).all(axis=1)]
        drawn[index[:, 1], index[:, 0]] = code

    row, column = np.nonzero(snapshot.occupied)
    cells = np.stack([column, row], axis=1) + 0.5
    dots(np.asarray(snapshot.origin) + cells * snapshot.resolution, _WALL)
    dots(snapshot.path, _PATH)
    dots(_echoes(snapshot), _ECHO)
    if cloud:
        dots(snapshot.particles[:, :2], _CLOUD)
    edge = np.clip(snapshot.goal, low + metres / 2, low + span - metres / 2)
    inside = (edge == snapshot.goal).all()
    dots(edge + disc(snapshot.arrive_distance if inside else 0.0, metres), _GOAL)
    for person in snapshot.pedestrian_position:
        dots(person + disc(snapshot.pedestrian_radius, metres), _PERSON)
    nose = snapshot.pose_true[:2] + 0.35 * direction(snapshot.pose_true[2])
    dots(np.vstack([snapshot.pose_true[:2] + disc(snapshot.robot_radius, metres), nose]), _ROBOT)
    dots(snapshot.pose_estimated[:2], _BELIEF)
    if cloud and snapshot.outcome == "lost":
        dots(snapshot.pose_true[:2] + metres * _CROSS, _LOST)
    return drawn[::-1]


_CROSS = np.array([[i, s * i] for i in range(-3, 4) for s in (-1, 1)], np.float64)


def disc(radius: float, metres: float = METRES) -> NDArray[np.float64]:
    """Points (n, 2) of a disc around the origin, its centre at least."""
    side = np.arange(-radius, radius + 1e-9, metres / 2) if radius > 0.0 else np.zeros(1)
    x, y = np.meshgrid(side, side)
    inside = x * x + y * y <= radius * radius
    return np.vstack([np.zeros((1, 2)), np.stack([x[inside], y[inside]], axis=1)])


def direction(yaw: float) -> NDArray[np.float64]:
    """The unit vector (2,) along ``yaw`` (rad)."""
    return np.array([np.cos(yaw), np.sin(yaw)])


def _echoes(snapshot: WorldSnapshot) -> NDArray[np.float64]:
    """Where the echoes lie, seen from the true pose; readings at range_max have none."""
    ranges = snapshot.scan.astype(np.float64)
    bearing = snapshot.field_of_view * (np.arange(len(ranges)) / len(ranges) - 0.5)
    angle = snapshot.pose_true[2] + bearing
    points = ranges[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return snapshot.pose_true[:2] + points[ranges < snapshot.range_max * 0.9999]
