"""Maps of the ROS map_server: a YAML file beside a PGM or PNG image.

The image's first row is the top (highest y); ``origin`` is the pose [x, y, yaw] of the lower left
corner of the lower left pixel. A pixel's occupancy is ``p = (255 - value) / 255``, with ``negate``
``value / 255``; mode ``raw`` holds percent instead, ``value / 100``, over 100 unknown. Above
``occupied_thresh`` a cell is solid, below ``free_thresh`` it is floor, between them unknown, as is
a transparent pixel in mode ``scale``. (map_server grades the cells between the thresholds in modes
scale and raw; its localization then takes every grade for unknown, so here they are that at once.)

What simulation needs beyond that: a map with a yaw is sampled anew, cell by cell, into a grid
along the map frame's axes; everything beyond the known cells is cut off; and where floor meets
the unknown or the image's edge, the nearest unknown cells count as wall, for rays end somewhere
and nobody may leave the map.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter
from pydantic import ConfigDict, Field, model_validator

from lndrl.errors import UserError
from lndrl.maps.grid import OccupancyGrid
from lndrl.models import Model, Positive, Probability, load_yaml, validate
from lndrl.scenario import MOST_CELLS

FREE, OCCUPIED, UNKNOWN, BEYOND = 0, 1, 2, 3  # the last: outside the image
Cells = NDArray[np.uint8]


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
        if self.free_thresh >= self.occupied_thresh:
            raise ValueError(
                f"free_thresh {self.free_thresh:g} must be below "
                f"occupied_thresh {self.occupied_thresh:g}"
            )
        return self


def load_ros_map(path: Path | str) -> OccupancyGrid:
    """Read the map that the YAML file ``path`` describes; the grid lies in the map frame.

    Raises UserError naming the file: missing or unreadable, keys missing, thresholds out of
    order, an image that is damaged or of another size than it says, no free cell.
    """
    path = Path(path)
    about = validate(MapFile, load_yaml(path), str(path))
    image = path.parent / about.image
    values, opaque = _read_image(image, path)
    cells = classify(values, opaque, about)[::-1]  # row 0 is the lowest y
    cells, origin = _along_the_axes(cells, about)
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
    return grid_of_cells(cells, about.resolution, origin, ring)


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


def classify(values: NDArray[np.float64], opaque: NDArray[np.bool_], about: MapFile) -> Cells:
    """FREE, OCCUPIED or UNKNOWN for pixel ``values`` (0 to 255) of the same shape."""
    if about.negate == (about.mode != "raw"):
        shade = values
    else:
        shade = 255.0 - values
    occupancy = shade / (100.0 if about.mode == "raw" else 255.0)
    cells = np.full(values.shape, UNKNOWN, np.uint8)
    cells[occupancy > about.occupied_thresh] = OCCUPIED
    cells[occupancy < about.free_thresh] = FREE
    if about.mode == "raw":
        cells[occupancy > 1.0] = UNKNOWN
    if about.mode == "scale":
        cells[~opaque] = UNKNOWN
    return cells


def _read_image(image: Path, path: Path) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Grey values in [0, 255] and which pixels are opaque, row 0 on top."""
    try:
        with Image.open(image) as opened:
            if opened.size[0] * opened.size[1] > MOST_CELLS:
                raise UserError(
                    f"{image}: {opened.size[0]} x {opened.size[1]} pixels are more than "
                    f"{MOST_CELLS:.0e}; cut the map or make it coarser"
                )
            _check_length(opened, image)
            opened.load()
            return _grey(opened)
    except FileNotFoundError:
        raise UserError(f"{image}: no such file; {path} names it as its image") from None
    except Image.DecompressionBombError:
        raise UserError(f"{image}: more pixels than can be read; cut the map") from None
    except (OSError, ValueError, SyntaxError) as error:
        raise UserError(
            f"{image}: is not a whole PGM or PNG image of the size it says ({error})"
        ) from None


def _check_length(opened: Image.Image, image: Path) -> None:
    """Refuse a binary PGM with more or fewer bytes than its header asks for."""
    tile = getattr(opened, "tile", None)
    if opened.format != "PPM" or not tile or image.read_bytes()[:2] != b"P5":
        return
    start = tile[0][2]  # where the pixels begin
    wide = 2 if opened.mode.startswith("I") else 1
    columns, rows = opened.size
    held, asked = image.stat().st_size - start, columns * rows * wide
    if held != asked:
        raise UserError(
            f"{image}: holds {held} bytes of pixels, but its header says {columns} x {rows}, "
            f"which needs {asked}"
        )


def _grey(opened: Image.Image) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    if opened.mode == "P" or "transparency" in opened.info:
        opened = opened.convert("RGBA")
    values: NDArray[Any] = np.asarray(opened)
    if values.dtype == np.bool_:
        values = values * 255.0
    elif opened.mode.startswith("I"):
        values = values * (255.0 / 65535.0)
    opaque = np.ones(values.shape[:2], np.bool_)
    if values.ndim == 3:
        if opened.mode in ("LA", "RGBA"):
            opaque = values[..., -1] == 255
            values = values[..., :-1]
        values = values.mean(axis=2)
    return values.astype(np.float64), opaque


def _along_the_axes(cells: Cells, about: MapFile) -> tuple[Cells, tuple[float, float]]:
    """The cells in a grid along the map frame's axes, and that grid's lower left corner (m).

    Nearest-neighbour sampling where the image is turned; corners it does not cover are BEYOND.
    """
    x, y, yaw = about.origin
    step = about.resolution
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
