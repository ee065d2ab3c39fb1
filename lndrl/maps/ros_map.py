"""Maps of the ROS map_server: a YAML file beside a PGM or PNG image.

The image's first row is the top (highest y); ``origin`` is the pose [x, y, yaw] of the lower left
corner of the lower left pixel. A pixel's occupancy is ``p = (255 - value) / 255``, with ``negate``
``value / 255``; mode ``raw`` holds percent instead, ``value / 100``, over 100 unknown. Above
``occupied_thresh`` a cell is solid, below ``free_thresh`` it is floor, between them unknown, as is
a pixel that is not opaque in modes trinary and scale. (map_server grades the cells between the
thresholds in mode scale, and all in mode raw; its localization then takes every grade for unknown,
so here cells between the thresholds are that at once.)

Where map servers differ, this reads as nav2 of Jazzy (May 2025) and later: map_server of ROS 1 and
nav2 up to Iron average alpha with the colours in mode trinary, so that opaque grey 205 is floor;
ROS 1 obeys ``negate`` in mode raw. ``RosMap.notes`` say where that matters. Colours count by their
mean, as in those; nav2 from Jazzy on weighs them by brightness.

What simulation needs beyond that: a map with a yaw is sampled anew, cell by cell, into a grid
along the map frame's axes; everything beyond the known cells is cut off; and where floor meets
the unknown or the image's edge, the nearest unknown cells count as wall, for rays end somewhere
and nobody may leave the map.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter
from pydantic import ConfigDict, Field, model_validator

from lndrl.errors import UserError
from lndrl.maps.grid import OccupancyGrid
from lndrl.maps.map_image import Pixels, read_image
from lndrl.models import Model, Positive, Probability, load_yaml, validate

FREE, OCCUPIED, UNKNOWN, BEYOND = 0, 1, 2, 3  # the last: outside the image
Cells = NDArray[np.uint8]

_MOST_YAW = 4.0 * np.pi  # rad; whoever adds up turns may well end beyond one
_SAVED_UNKNOWN = 205.0  # what map_saver writes, of ROS 1 and 2; p = 0.196
_WORTH_SAYING = 0.001  # share of the pixels


class MapFile(Model):
    """What the YAML file of a map says (names and defaults of ROS map_server)."""

    model_config = ConfigDict(extra="ignore")

    image: str = Field(description="PGM or PNG, relative to the YAML file")
    resolution: Positive = Field(description="m per pixel")
    origin: tuple[float, float, float] = Field(description="x, y (m), yaw (rad)")
    negate: bool
    occupied_thresh: Probability
    free_thresh: Probability
    mode: Literal["trinary", "scale", "raw"] = "trinary"

    @model_validator(mode="after")
    def _order(self) -> MapFile:
        yaw = self.origin[2]
        if abs(yaw) > _MOST_YAW:
            raise ValueError(
                f"origin: the yaw {yaw:g} is more than two turns; it is in radians, and {yaw:g} "
                f"degrees are {np.radians(yaw):.4g}"
            )
        if self.free_thresh >= self.occupied_thresh:
            raise ValueError(
                f"free_thresh {self.free_thresh:g} must be below "
                f"occupied_thresh {self.occupied_thresh:g}"
            )
        return self


class RosMap(NamedTuple):
    """A map as it was read: ``grid`` in the map frame; ``notes`` are sentences for its owner."""

    grid: OccupancyGrid
    notes: tuple[str, ...]


def load_ros_map(path: Path | str) -> RosMap:
    """Read the map that the YAML file ``path`` describes.

    Raises UserError naming the file: missing or unreadable, keys missing, thresholds out of
    order, an image that is damaged or of another size than it says, no free cell.
    """
    path = Path(path)
    about = validate(MapFile, load_yaml(path), str(path))
    image = path.parent / about.image
    pixels = read_image(image, path)
    cells = classify(pixels, about)
    notes = _notes(pixels, cells, about, path.name)
    cells, origin = along_the_axes(cells[::-1], about.resolution, about.origin)  # row 0: lowest y
    known = cells < UNKNOWN
    if not (cells == FREE).any():
        raise UserError(
            f"{image}: no pixel is free floor; {path} has negate: {int(about.negate)} and "
            f"free_thresh: {about.free_thresh:g}"
        )
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    bottom, left = rows[0], columns[0]
    ring = np.pad(cells, 1, constant_values=BEYOND)
    ring = ring[bottom : rows[-1] + 3, left : columns[-1] + 3]
    cells = cells[bottom : rows[-1] + 1, left : columns[-1] + 1]
    origin = (origin[0] + left * about.resolution, origin[1] + bottom * about.resolution)
    return RosMap(grid_of_cells(cells, about.resolution, origin, ring), notes)


def grid_of_cells(
    cells: Cells,
    resolution: float,
    origin: tuple[float, float],
    ring: Cells | None = None,
) -> OccupancyGrid:
    """A closed grid of ``cells`` (rows, columns) FREE, OCCUPIED, UNKNOWN or BEYOND, row 0 the
    lowest y.

    ``ring`` are the cells with one more on every side, which is needed where floor lies at the
    edge; without it they are taken for UNKNOWN.
    """
    edge = np.ones(cells.shape, np.bool_)
    edge[1:-1, 1:-1] = False
    if (edge & (cells == FREE)).any():
        cells = np.pad(cells, 1, constant_values=UNKNOWN) if ring is None else ring
        origin = (origin[0] - resolution, origin[1] - resolution)
    free = cells == FREE
    unknown = cells >= UNKNOWN
    # Diagonally too: a ray or a step must not slip between two cells.
    near_free = np.asarray(Image.fromarray(free.view(np.uint8)).filter(ImageFilter.MaxFilter(3)))
    seam = unknown & (near_free > 0)
    deep = unknown & ~seam
    edge = seam & (cells == BEYOND)
    return OccupancyGrid(
        ~free, resolution, origin, deep if deep.any() else None, edge if edge.any() else None
    )


def classify(pixels: Pixels, about: MapFile) -> Cells:
    """FREE, OCCUPIED or UNKNOWN for each of ``pixels``."""
    occupancy = _occupancy(pixels.shade, about)
    cells = np.full(occupancy.shape, UNKNOWN, np.uint8)
    cells[occupancy > about.occupied_thresh] = OCCUPIED
    cells[occupancy < about.free_thresh] = FREE
    if about.mode == "raw":
        cells[occupancy > 1.0] = UNKNOWN
    elif pixels.alpha is not None:
        cells[pixels.alpha < 255.0] = UNKNOWN
    return cells


def _occupancy(shade: NDArray[np.float64], about: MapFile) -> NDArray[np.float64]:
    """0 floor to 1 wall; above 1 unknown."""
    if about.mode == "raw":
        return shade / 100.0
    return (shade if about.negate else 255.0 - shade) / 255.0


def _notes(pixels: Pixels, cells: Cells, about: MapFile, name: str) -> tuple[str, ...]:
    """Where this reading may not be what is meant, or another map server's, and what helps."""
    if about.mode == "raw":
        if not about.negate:
            return ()
        return (
            f"{name}: mode raw takes no notice of negate, as in ROS 2; ROS 1 takes 255 - value",
        )
    notes = []
    floor = float(((np.abs(pixels.shade - _SAVED_UNKNOWN) < 1e-6) & (cells == FREE)).mean())
    if floor >= _WORTH_SAYING:
        notes.append(
            f"{name}: free_thresh {about.free_thresh:g} makes floor of grey 205, {floor:.1%} of "
            f"{about.image}; map_saver writes it for unknown, and free_thresh: 0.196 keeps it that"
        )
    if about.mode == "trinary" and pixels.alpha is not None:
        averaged = Pixels(0.75 * pixels.shade + 0.25 * pixels.alpha, None)
        other = float((classify(averaged, about) != cells).mean())
        if other >= _WORTH_SAYING:
            notes.append(
                f"{name}: ROS 1, and ROS 2 up to Iron, average alpha with the colours and "
                f"read {other:.1%} of {about.image} otherwise; without alpha all read the same"
            )
    return tuple(notes)


def along_the_axes(
    cells: Cells, step: float, origin: tuple[float, float, float]
) -> tuple[Cells, tuple[float, float]]:
    """``cells``, row 0 the lowest y, in a grid along the map frame's axes, and that grid's lower
    left corner (m); ``step`` is a cell's side (m), ``origin`` x, y, yaw of the corner of the first.

    Nearest-neighbour sampling where the image is turned; corners it does not cover are BEYOND.
    """
    x, y, yaw = origin
    yaw = float(np.arctan2(np.sin(yaw), np.cos(yaw)))
    if abs(yaw) * max(cells.shape) < 1e-3:  # moves no corner by a thousandth of a cell
        return cells, (x, y)
    rows, columns = cells.shape
    c, s = np.cos(yaw), np.sin(yaw)
    corners = step * np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], np.float64)
    turned = corners @ np.array([[c, s], [-s, c]])
    low, high = turned.min(axis=0), turned.max(axis=0)
    width, height = np.ceil((high - low) / step - 1e-6).astype(int)
    along = low[0] + step * (np.arange(width) + 0.5)
    up = low[1] + step * (np.arange(height)[:, None] + 0.5)
    column = np.floor((c * along + s * up) / step).astype(int)
    row = np.floor((c * up - s * along) / step).astype(int)
    inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
    out = np.full((height, width), BEYOND, np.uint8)
    out[inside] = cells[row[inside], column[inside]]
    return out, (x + float(low[0]), y + float(low[1]))
