"""Ray casting on a distance field: sphere marching in the open, cell by cell near obstacles.

A field value is the distance between cell CENTRES, so from any point of a cell no occupied cell
is nearer than ``value - sqrt(2)`` cells: that much is skipped at once. Where two cells or fewer
are left the ray walks from cell border to cell border (Amanatides & Woo 1987), which
makes the range exact on the grid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.kernels import kernel
from lndrl.maps.grid import OccupancyGrid

_DIAGONAL = 1.4143  # cells; two half diagonals, rounded up
_NEAR = 2.5  # cells; below this the walk is cell by cell
_FAR_AWAY = 1e30
_LEVEL = 1e-12  # direction components below it never change the cell


def clearance(distance: NDArray[np.float32], resolution: float) -> NDArray[np.uint8]:
    """A distance field (m) in whole cells, rounded down, at most 255: what rays march on.

    A quarter of the field's size, so that it stays in the cache of a core.
    """
    cells = np.floor(distance / resolution + 1e-3)
    return np.minimum(cells, 255.0).astype(np.uint8)


@kernel(_nrt=False)
def cast_ray(cells, inverse_resolution, origin_x, origin_y, x, y, dx, dy, range_max):
    """Range (m) along the unit vector (dx, dy) from (x, y), ``range_max`` where nothing is hit.

    ``cells`` is the ``clearance``. 0 when the point lies in an occupied cell; leaving the grid
    counts as no hit.
    """
    rows, columns = cells.shape
    start_x = (x - origin_x) * inverse_resolution
    start_y = (y - origin_y) * inverse_resolution
    limit = range_max * inverse_resolution
    inverse_x = 1.0 / dx if abs(dx) > _LEVEL else 0.0
    inverse_y = 1.0 / dy if abs(dy) > _LEVEL else 0.0
    ahead_x = 1.0 if dx > 0.0 else 0.0
    ahead_y = 1.0 if dy > 0.0 else 0.0
    step_column = 1 if dx > 0.0 else -1
    step_row = 1 if dy > 0.0 else -1
    travelled = 0.0
    while travelled < limit:
        cell_x = start_x + travelled * dx
        cell_y = start_y + travelled * dy
        # Written so that NaN, too, lies off the grid.
        if not (cell_x >= 0.0 and cell_y >= 0.0 and cell_x < columns and cell_y < rows):
            return range_max
        column = int(cell_x)
        row = int(cell_y)
        room = np.float64(cells[row, column])
        if room > _NEAR:
            travelled += room - _DIAGONAL
            continue
        next_x = _FAR_AWAY
        next_y = _FAR_AWAY
        if abs(dx) > _LEVEL:
            next_x = travelled + (column + ahead_x - cell_x) * inverse_x
        if abs(dy) > _LEVEL:
            next_y = travelled + (row + ahead_y - cell_y) * inverse_y
        while room <= _NEAR:
            if room < 0.5:
                return min(travelled, limit) / inverse_resolution
            if next_x < next_y:
                travelled = next_x
                next_x += abs(inverse_x)
                column += step_column
            else:
                travelled = next_y
                next_y += abs(inverse_y)
                row += step_row
            if row < 0 or column < 0 or row >= rows or column >= columns:
                return range_max
            room = np.float64(cells[row, column])
        travelled += max(room - _DIAGONAL, 0.0)
    return range_max


@kernel(_nrt=False)
def cast_rays(cells, inverse_resolution, origin_x, origin_y, pose, bearings, range_max, out):
    """Fill ``out`` (float32, (n,)) with the ranges at ``bearings`` (rad, (n,)) from ``pose``."""
    for i in range(len(bearings)):
        angle = pose[2] + bearings[i]
        out[i] = cast_ray(
            cells,
            inverse_resolution,
            origin_x,
            origin_y,
            pose[0],
            pose[1],
            np.cos(angle),
            np.sin(angle),
            range_max,
        )


def raycast(
    grid: OccupancyGrid,
    distance: NDArray[np.float32],
    pose: NDArray[np.float64],
    bearings: NDArray[np.float64],
    range_max: float,
) -> NDArray[np.float32]:
    """Ranges (m, ``(n,)``) from ``pose`` [x, y, yaw] at ``bearings`` (rad, robot frame).

    ``distance`` is the grid's ``distance_field``; no noise, no pedestrians.
    """
    out = np.empty(len(bearings), dtype=np.float32)
    cells = clearance(distance, grid.resolution)
    cast_rays(cells, 1.0 / grid.resolution, *grid.origin, pose, bearings, range_max, out)
    return out


@kernel(_nrt=False)
def sample_field(distance, inverse_resolution, x, y):
    """Field value (m) at a point by bilinear interpolation, grid origin at (0, 0).

    Outside the grid, and for NaN, 0: nobody stands there.
    """
    rows, columns = distance.shape
    column = x * inverse_resolution - 0.5
    row = y * inverse_resolution - 0.5
    if not (column >= -0.5 and row >= -0.5 and column <= columns - 0.5 and row <= rows - 0.5):
        return 0.0
    column = min(max(column, 0.0), columns - 1.0)
    row = min(max(row, 0.0), rows - 1.0)
    c = min(int(column), max(columns - 2, 0))
    r = min(int(row), max(rows - 2, 0))
    c1 = min(c + 1, columns - 1)
    r1 = min(r + 1, rows - 1)
    a = column - c
    b = row - r
    low = distance[r, c] * (1.0 - a) + distance[r, c1] * a
    high = distance[r1, c] * (1.0 - a) + distance[r1, c1] * a
    return low * (1.0 - b) + high * b
