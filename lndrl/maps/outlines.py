"""Outlines of everything solid: closed polygons with the solid side on the left of every edge.

So obstacles run counter-clockwise and the inside of the outer wall clockwise, as ORCA's
obstacles do. A polygon (n, 2) lists its corners once (m); its last edge leads back to the first.
"""

from __future__ import annotations

import contourpy
import numpy as np
from numpy.typing import NDArray
from pymunk.autogeometry import simplify_curves

from lndrl.maps.grid import OccupancyGrid
from lndrl.scenario import Obstacle, Scenario

Outline = NDArray[np.float64]

CIRCLE_TOLERANCE = 0.01  # m between a circle and its outline; a fifth of the usual cell
_SLACK = 0.25  # cells; straightening stays within, so outlines stay within half a cell


def geometry_outlines(scenario: Scenario) -> tuple[Outline, ...]:
    """Exact outlines of a geometry scenario: the outer wall's inside first, then each obstacle.

    Circles become polygons with their corners on the circle, within ``CIRCLE_TOLERANCE``.
    Obstacles may overlap.
    """
    outlines = []
    if scenario.wall > 0:
        inner = _box(
            scenario.wall,
            scenario.wall,
            scenario.size[0] - scenario.wall,
            scenario.size[1] - scenario.wall,
        )
        outlines.append(inner[::-1].copy())
    return (*outlines, *(_obstacle(obstacle) for obstacle in scenario.obstacles))


def grid_outlines(grid: OccupancyGrid) -> tuple[Outline, ...]:
    """Outlines of a grid's occupied cells, within half a cell of the cells' own borders.

    In metres from the grid's lower left corner (its ``origin`` is left out). Lines run through
    the middles of the cells' borders, which makes slanted walls straight. The grid's edge counts
    as solid.
    """
    solid = np.pad(grid.occupied, 1, constant_values=True).astype(np.float64)
    rows, columns = solid.shape
    contours = contourpy.contour_generator(
        np.arange(columns) - 0.5, np.arange(rows) - 0.5, solid, name="serial", line_type="Separate"
    )
    lines: list[Outline] = [np.asarray(line) for line in contours.lines(0.5)]
    return tuple(_straighten(line, solid) * grid.resolution for line in lines)


def circle_corners(radius: float) -> int:
    """Corners of a circle's outline, 8 at least: as few as the tolerance allows."""
    share = min(CIRCLE_TOLERANCE / radius, 0.5)
    return max(8, int(np.ceil(np.pi / np.arccos(1.0 - share))))


def segments(outlines: tuple[Outline, ...]) -> NDArray[np.float64]:
    """All edges, ``(S, 4)`` [x0, y0, x1, y1] (m), in the outlines' order and direction."""
    edges = [np.hstack([o, np.roll(o, -1, axis=0)]) for o in outlines]
    return np.concatenate(edges) if edges else np.zeros((0, 4))


def signed_area(outline: Outline) -> float:
    """Area (m²) inside, above 0 for counter-clockwise corners."""
    x, y = outline.T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def _straighten(line: Outline, solid: NDArray[np.float64]) -> Outline:
    """A closed contour (cells, first point repeated at the end) with few corners, solid left."""
    # Between two cells along the way: the one on the left must be solid.
    (x0, y0), (x1, y1) = line[0], line[1]
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
    left = middle + 0.3 * np.array([y0 - y1, x1 - x0]) / np.hypot(x1 - x0, y1 - y0)
    if _value(solid, *left) < _value(solid, *middle):
        line = line[::-1]
    curve = simplify_curves([tuple(point) for point in line.tolist()], _SLACK)
    corners = np.array([tuple(point) for point in curve][:-1], np.float64)
    return corners if len(corners) >= 3 else line[:-1].copy()


def _value(solid: NDArray[np.float64], x: float, y: float) -> float:
    """Bilinear value at a point in cells of the unpadded grid."""
    column, row = x + 0.5, y + 0.5
    c = min(int(column), solid.shape[1] - 2)
    r = min(int(row), solid.shape[0] - 2)
    a, b = column - c, row - r
    low = solid[r, c] * (1 - a) + solid[r, c + 1] * a
    high = solid[r + 1, c] * (1 - a) + solid[r + 1, c + 1] * a
    return float(low * (1 - b) + high * b)


def _obstacle(obstacle: Obstacle) -> Outline:
    if obstacle.box is not None:
        return _box(*obstacle.box)
    if obstacle.circle is not None:
        x, y, radius = obstacle.circle
        angle = np.linspace(0.0, 2.0 * np.pi, circle_corners(radius), endpoint=False)
        return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1)
    corners = np.array(obstacle.polygon or [], np.float64)
    return corners if signed_area(corners) >= 0 else corners[::-1].copy()


def _box(x0: float, y0: float, x1: float, y1: float) -> Outline:
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], np.float64)


__all__ = ["circle_corners", "geometry_outlines", "grid_outlines", "segments", "signed_area"]
