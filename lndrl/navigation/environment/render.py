"""A small picture of a snapshot in plain NumPy: the Gymnasium environment's ``rgb_array``.

Image rows run from the highest y down, columns from the lowest x up. Drawings for people (plots,
films, reports) are made elsewhere; this one needs no plotting library.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.navigation.snapshot import WorldSnapshot

Image = NDArray[np.uint8]
Color = tuple[int, int, int]

FLOOR: Color = (250, 250, 248)
WALL: Color = (40, 40, 45)
GOAL: Color = (150, 210, 150)
PATH: Color = (120, 160, 230)
PATH_ESTIMATED: Color = (240, 190, 120)
SCAN: Color = (220, 60, 60)
PARTICLE: Color = (250, 150, 50)
PERSON: Color = (190, 225, 190)
LEG: Color = (40, 130, 60)
ROBOT: Color = (40, 80, 200)
ESTIMATE: Color = (230, 120, 20)


def render_snapshot(snapshot: WorldSnapshot, pixels_per_metre: float = 20.0) -> Image:
    """Draw ``snapshot`` as uint8 (height, width, 3)."""
    canvas = _Canvas(snapshot, pixels_per_metre)
    canvas.disc(snapshot.goal, snapshot.arrive_distance, GOAL)
    canvas.dots(snapshot.path_estimated, PATH_ESTIMATED, 1)
    canvas.dots(snapshot.path, PATH, 1)
    for position in snapshot.pedestrian_position:
        canvas.disc(position, snapshot.pedestrian_radius, PERSON)
    for position in snapshot.leg_position:
        canvas.disc(position, snapshot.leg_radius, LEG)
    canvas.dots(_scan_points(snapshot), SCAN, 1)
    canvas.dots(snapshot.particles[:, :2], PARTICLE, 0)
    canvas.disc(snapshot.pose_true[:2], snapshot.robot_radius, ROBOT)
    canvas.heading(snapshot.pose_true, 2.5 * snapshot.robot_radius, ROBOT)
    canvas.disc(snapshot.pose_estimated[:2], 0.5 * snapshot.robot_radius, ESTIMATE)
    canvas.heading(snapshot.pose_estimated, 2.5 * snapshot.robot_radius, ESTIMATE)
    return canvas.image


class _Canvas:
    def __init__(self, snapshot: WorldSnapshot, scale: float) -> None:
        rows, columns = snapshot.occupied.shape
        self.scale = scale
        self.origin = snapshot.origin
        self.height = max(1, round(rows * snapshot.resolution * scale))
        self.width = max(1, round(columns * snapshot.resolution * scale))
        row = np.arange(self.height) * rows // self.height
        column = np.arange(self.width) * columns // self.width
        occupied = snapshot.occupied[::-1][np.ix_(row, column)]
        self.image = np.where(
            occupied[..., None], np.array(WALL, np.uint8), np.array(FLOOR, np.uint8)
        )

    def _pixels(self, points: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns, possibly outside the image."""
        points = np.asarray(points, np.float64).reshape(-1, 2)
        column = np.floor((points[:, 0] - self.origin[0]) * self.scale)
        row = self.height - 1 - np.floor((points[:, 1] - self.origin[1]) * self.scale)
        return row.astype(np.intp), column.astype(np.intp)

    def dots(self, points: NDArray[np.float64], color: Color, margin: int) -> None:
        """Squares of 2 * margin + 1 pixels around each point (n, 2)."""
        row, column = self._pixels(points)
        for down in range(-margin, margin + 1):
            for right in range(-margin, margin + 1):
                r, c = row + down, column + right
                seen = (r >= 0) & (r < self.height) & (c >= 0) & (c < self.width)
                self.image[r[seen], c[seen]] = color

    def disc(self, centre: NDArray[np.float64], radius: float, color: Color) -> None:
        """A filled disc, at least one pixel."""
        (row,), (column,) = self._pixels(centre)
        reach = int(np.ceil(radius * self.scale))
        top, left = max(0, row - reach), max(0, column - reach)
        window = self.image[top : max(0, row + reach + 1), left : max(0, column + reach + 1)]
        r = np.arange(window.shape[0])[:, None] + top - row
        c = np.arange(window.shape[1])[None, :] + left - column
        window[r * r + c * c <= max(0.5, radius * self.scale) ** 2] = color

    def heading(self, pose: NDArray[np.float64], length: float, color: Color) -> None:
        """A line from ``pose`` (3,) in its direction."""
        along = np.linspace(0.0, length, max(2, int(2 * length * self.scale)))
        direction = np.array([np.cos(pose[2]), np.sin(pose[2])])
        self.dots(pose[:2] + along[:, None] * direction, color, 0)


def _scan_points(snapshot: WorldSnapshot) -> NDArray[np.float64]:
    """Where the echoes lie, seen from the true pose; readings at range_max have no echo."""
    ranges = snapshot.scan.astype(np.float64)
    increment = snapshot.field_of_view / len(ranges)
    bearing = -0.5 * snapshot.field_of_view + increment * np.arange(len(ranges))
    angle = snapshot.pose_true[2] + bearing
    points = snapshot.pose_true[:2] + ranges[:, None] * np.stack(
        [np.cos(angle), np.sin(angle)], axis=1
    )
    return points[ranges < snapshot.range_max * 0.9999]
