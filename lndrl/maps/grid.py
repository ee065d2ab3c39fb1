"""Occupancy grids: geometry to cells, cells to distances.

Row 0 is the LOWEST y, so ``occupied[row, col]`` grows with y and x like the map frame does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.scenario import Obstacle, Point, Scenario

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class OccupancyGrid:
    """Which cells of a place are solid.

    ``occupied`` is ``(height, width)``; cell (r, c) covers x in
    ``[ox + c * resolution, ox + (c + 1) * resolution)`` and y likewise with r (metres, map frame).
    ``unknown`` are those of the occupied cells about which a map says nothing: nobody walks and
    no laser looks there, but they are no obstacles to a localization. ``edge`` are those that
    stand where a map's image ends beside floor.
    """

    occupied: Mask
    resolution: float
    origin: tuple[float, float] = (0.0, 0.0)
    unknown: Mask | None = None
    edge: Mask | None = None

    @property
    def mapped(self) -> Mask:
        """Occupied cells that the map knows to be occupied, ``(height, width)``."""
        return self.occupied if self.unknown is None else self.occupied & ~self.unknown

    @property
    def free(self) -> Mask:
        """Cells that are not occupied, ``(height, width)``."""
        return ~self.occupied

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.occupied.shape[0], self.occupied.shape[1]

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in metres."""
        rows, columns = self.shape
        return columns * self.resolution, rows * self.resolution

    def index(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of the cell that holds the point (m); may lie outside the grid."""
        column = int(np.floor((x - self.origin[0]) / self.resolution))
        row = int(np.floor((y - self.origin[1]) / self.resolution))
        return row, column

    def contains(self, x: float, y: float) -> bool:
        """Whether the point (m) lies on the grid."""
        row, column = self.index(x, y)
        rows, columns = self.shape
        return 0 <= row < rows and 0 <= column < columns

    def center(self, row: int, column: int) -> tuple[float, float]:
        """Centre of a cell (m, map frame)."""
        return (
            self.origin[0] + (column + 0.5) * self.resolution,
            self.origin[1] + (row + 0.5) * self.resolution,
        )


def distance_field(occupied: Mask, resolution: float) -> NDArray[np.float32]:
    """Metres from every cell's centre to the nearest occupied cell's centre, ``(h, w)``.

    0 on occupied cells; without any occupied cell everything is the grid's diagonal away.
    """
    if not occupied.any():
        diagonal = float(np.hypot(*occupied.shape)) * resolution
        return np.full(occupied.shape, diagonal, dtype=np.float32)
    from scipy.ndimage import distance_transform_edt  # takes longer to import than a map to read

    distance: NDArray[np.float64] = distance_transform_edt(~occupied, sampling=resolution)
    return distance.astype(np.float32)


def grid_from_scenario(scenario: Scenario) -> OccupancyGrid:
    """Rasterise a scenario: a cell is occupied when its centre lies in an obstacle or outer wall.

    Boxes and circles count as at least one cell wide, so thin walls and posts do not vanish at
    coarse resolutions; a polygon that covers no cell centre occupies the cell of its middle.
    """
    resolution = scenario.resolution
    width, height = scenario.size
    columns = max(1, round(width / resolution))
    rows = max(1, round(height / resolution))
    x = (np.arange(columns, dtype=np.float64) + 0.5) * resolution
    y = (np.arange(rows, dtype=np.float64) + 0.5) * resolution
    occupied = np.zeros((rows, columns), dtype=np.bool_)
    if scenario.wall > 0:
        inside_x = (x > scenario.wall) & (x < width - scenario.wall)
        inside_y = (y > scenario.wall) & (y < height - scenario.wall)
        occupied |= ~(inside_y[:, None] & inside_x[None, :])
    for obstacle in scenario.obstacles:
        # Around it only: all cells for each of hundreds of obstacles take most of a minute.
        low, high = _bounds(obstacle)
        across = _cells_around(low[0], high[0], columns, resolution)
        up = _cells_around(low[1], high[1], rows, resolution)
        occupied[up, across] |= _covered(obstacle, x[across], y[up], resolution)
    return OccupancyGrid(occupied, resolution)


def polygon_mask(polygon: list[Point], x: NDArray[np.float64], y: NDArray[np.float64]) -> Mask:
    """Even-odd rule on a lattice: ``(len(y), len(x))``, true where the point is inside."""
    inside = np.zeros((len(y), len(x)), dtype=np.bool_)
    for (x0, y0), (x1, y1) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        if y0 == y1:
            continue
        spans = (y >= min(y0, y1)) & (y < max(y0, y1))
        crossing = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
        inside ^= spans[:, None] & (x[None, :] < crossing[:, None])
    return inside


def _bounds(obstacle: Obstacle) -> tuple[Point, Point]:
    """Lower left and upper right corner of the box around an obstacle (m)."""
    if obstacle.box is not None:
        return obstacle.box[:2], obstacle.box[2:]
    if obstacle.circle is not None:
        x, y, radius = obstacle.circle
        return (x - radius, y - radius), (x + radius, y + radius)
    corners = np.array(obstacle.polygon)
    low, high = corners.min(axis=0), corners.max(axis=0)
    return (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))


def _cells_around(low: float, high: float, count: int, resolution: float) -> slice:
    """Cells of an axis that [low, high] (m) may cover, two more on either side."""
    first, last = np.clip([low / resolution - 2.0, high / resolution + 3.0], 0.0, count)
    return slice(int(first), int(last))


def _covered(
    obstacle: Obstacle, x: NDArray[np.float64], y: NDArray[np.float64], resolution: float
) -> Mask:
    if obstacle.box is not None:
        x_min, y_min, x_max, y_max = obstacle.box
        inside_x = _span(x_min, x_max, x, resolution)
        inside_y = _span(y_min, y_max, y, resolution)
        mask: Mask = inside_y[:, None] & inside_x[None, :]
        return mask
    if obstacle.circle is not None:
        cx, cy, radius = obstacle.circle
        radius = max(radius, 0.7072 * resolution)
        disc: Mask = (x[None, :] - cx) ** 2 + (y[:, None] - cy) ** 2 <= radius * radius
        return disc
    polygon = obstacle.polygon or []
    mask = polygon_mask(polygon, x, y)
    if not mask.any():
        middle_x, middle_y = np.mean(polygon, axis=0)
        mask = _nearest(y, middle_y, resolution)[:, None] & _nearest(x, middle_x, resolution)
    return mask


def _nearest(centers: NDArray[np.float64], value: float, resolution: float) -> Mask:
    """The cell that holds ``value``, if there is one."""
    return np.floor(centers / resolution) == value // resolution


def _span(low: float, high: float, centers: NDArray[np.float64], resolution: float) -> Mask:
    """Centres in [low, high], the interval being widened to one cell where it is thinner."""
    if high - low < resolution:
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * resolution, middle + 0.5 * resolution
    inside: Mask = (centers >= low - 1e-9) & (centers <= high + 1e-9)
    return inside
