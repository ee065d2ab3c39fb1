"""Which floor of a map people and tasks are put on, and whether it may lie outdoors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from lndrl.errors import UserError
from lndrl.maps.grid import OccupancyGrid
from lndrl.scenario import Point, Scenario

Regions = NDArray[np.int32]
Floats = NDArray[np.float64]


def floor_around(
    scenario: Scenario, grid: OccupancyGrid, regions: Regions, origin: Point, radius: float
) -> int:
    """The number in ``regions`` (h, w) of the floor that holds the point ``scenario.inside``.

    The point lies in the frame of ``grid``; ``origin`` is that frame's in the map's, for sentences.
    Raises UserError when the point is off the map, in a wall, or so near to one that a robot of
    ``radius`` m does not fit.
    """
    assert scenario.inside is not None
    x, y = scenario.inside
    said = f"scenario {scenario.name}: inside {_shown(scenario.inside, origin)}"
    if not grid.contains(x, y):
        corners = _shown((0.0, 0.0), origin) + _shown(grid.size, origin)
        raise UserError(f"{said} lies off the map; it must lie in {corners}")
    cell = grid.index(x, y)
    if grid.occupied[cell]:
        raise UserError(f"{said} lies in a wall or where the map is unknown; move it to free floor")
    if regions[cell] == 0:
        raise UserError(
            f"{said} is too near to a wall for a robot of radius {radius:g} m; move it to where "
            "there is room"
        )
    return int(regions[cell])


def edge_note(
    scenario: Scenario, grid: OccupancyGrid, regions: Regions, radius: float, found: list[Floats]
) -> str:
    """A sentence when a floor with one of the ``found`` places (m) reaches the image's edge, or "".

    A robot of ``radius`` m stands there with nothing but the end of the image beside it: what was
    drawn is no closed building, or its outdoors is floor, too.
    """
    numbers = {int(regions[grid.index(*point)]) for point in found} - {0}
    if not any(_reaches_edge(grid, regions, number, radius) for number in sorted(numbers)):
        return ""
    if scenario.inside is None:
        return (
            "the floor reaches the edge of the image, so people and tasks may lie outdoors; "
            "inside: [x, y] chooses the floor around a point of the building"
        )
    return (
        "the floor around inside reaches the edge of the image, so people and tasks may lie "
        "outdoors; close the building's doors in the map"
    )


def _reaches_edge(grid: OccupancyGrid, regions: Regions, number: int, radius: float) -> bool:
    if grid.edge is None:
        return False
    rows, columns = np.nonzero(grid.free & binary_dilation(grid.edge, np.ones((3, 3), np.bool_)))
    # The robot's centre keeps this many cells to the edge, and more to one behind a wall.
    reach = int(radius / grid.resolution + 0.5) + 1
    for up in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            if up * up + right * right <= reach * reach:
                row = np.clip(rows + up, 0, regions.shape[0] - 1)
                column = np.clip(columns + right, 0, regions.shape[1] - 1)
                if (regions[row, column] == number).any():
                    return True
    return False


def _shown(point: Point, origin: Point) -> list[float]:
    return [round(point[i] + origin[i], 3) for i in range(2)]
