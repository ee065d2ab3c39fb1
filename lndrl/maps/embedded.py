"""A map inside its scenario: read once where the file lies, then carried along as text."""

from __future__ import annotations

import base64
import binascii
import zlib
from pathlib import Path

import numpy as np

from lndrl.errors import UserError
from lndrl.maps.grid import OccupancyGrid
from lndrl.maps.ros_map import BEYOND, FREE, OCCUPIED, UNKNOWN, load_ros_map
from lndrl.scenario import MapCells, Scenario


def with_map(scenario: Scenario, folder: Path | None = None) -> Scenario:
    """``scenario`` with the cells of the map that it names, read from ``folder`` or from here.

    Anything but a map scenario without cells comes back as it is. Raises UserError for what
    ``load_ros_map`` refuses.
    """
    if scenario.kind != "map" or scenario.cells is not None:
        return scenario
    assert scenario.map is not None  # the model has seen to it
    grid, notes = load_ros_map((folder or Path()) / scenario.map)
    cells = pack(grid).model_copy(update={"notes": list(notes)})
    return scenario.model_copy(
        update={"cells": cells, "resolution": grid.resolution, "size": grid.size}
    )


def pack(grid: OccupancyGrid) -> MapCells:
    """The cells of ``grid`` as text; ``unpack`` gives the same grid back."""
    cells = np.where(grid.occupied, OCCUPIED, FREE).astype(np.uint8)
    if grid.unknown is not None:
        cells[grid.unknown] = UNKNOWN
    if grid.edge is not None:
        cells[grid.edge] = BEYOND
    rows, columns = grid.shape
    data = base64.b64encode(zlib.compress(cells.tobytes(), 9)).decode("ascii")
    return MapCells(rows=rows, columns=columns, origin=grid.origin, data=data)


def unpack(scenario: Scenario) -> OccupancyGrid:
    """The grid that ``with_map`` packed into ``scenario``, in the map frame.

    Raises UserError when the text does not hold that many cells.
    """
    packed = scenario.cells
    assert packed is not None
    count = packed.rows * packed.columns
    try:
        inflate = zlib.decompressobj()
        data = inflate.decompress(base64.b64decode(packed.data, validate=True), count + 1)
    except (binascii.Error, zlib.error) as error:
        raise UserError(f"scenario {scenario.name}: cells.data is damaged ({error})") from None
    cells = np.frombuffer(data, np.uint8)
    if cells.size != count or cells.max(initial=0) > BEYOND:
        raise UserError(
            f"scenario {scenario.name}: cells.data holds {cells.size} cells; "
            f"{packed.rows} x {packed.columns} of 0, 1, 2 and 3 are needed"
        )
    cells = cells.reshape(packed.rows, packed.columns)
    unknown, edge = cells == UNKNOWN, cells == BEYOND
    return OccupancyGrid(
        cells != FREE,
        scenario.resolution,
        packed.origin,
        unknown if unknown.any() else None,
        edge if edge.any() else None,
    )
