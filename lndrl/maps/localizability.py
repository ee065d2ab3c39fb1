"""How well one scan pins the pose down, place by place and heading by heading.

The Fisher information of a scan against the map, as perception-aware planners keep it (Chai et al.
2024, LF-3PM; Censi 2007 for a laser's): every beam that ends on a wall with the normal n, r metres
along the unit vector d, tells the distance of its end from that wall, and that distance changes
with the pose by

    J = [n_x, n_y, r (n_y d_x - n_x d_y)]        per m, per m, per rad.

(The range itself changes by -J / (n . d): its slope times |n . d| is what is left once the error is
counted across the wall, as a likelihood field does. So a wall that is merely grazed counts no more
than one that is faced.) The information of a scan is the sum of J^T J / sigma^2. From it stays the
information about the position when yaw has to be estimated as well, and of that the least over all
directions: one over its root is the deviation (m) along whichever direction the scan tells least
about. Beams that end on nothing, and those that end on what a map does not know, bring nothing.

Knows of a laser what ``Sensor`` says, and nothing of robots.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.kernels import kernel
from lndrl.maps.grid import OccupancyGrid
from lndrl.maps.raycast import cast_ray

HEADINGS = 16
"""Headings that a field has values for, evenly from 0 on; between them it is interpolated."""
DIRECTIONS = 20 * HEADINGS
"""Rays around every place; a scan from any of the headings is a run of them."""
SPACING = 0.25
"""m between two places."""
SMOOTHING = 0.1
"""m, deviation of the bell by which walls are smoothed for their normals. Cells make stairs of a
slanting wall; a filter that allows for errors of decimetres sees the slant."""
_MOST_PLACES = 60_000  # beyond, places lie farther apart
_TERMS = 6  # xx, xy, yy, xt, yt, tt of J^T J
_NUDGE = 0.25  # cells, from where a ray ends to the cells on both sides of the face
_NOTHING = 1e-9  # share of the information in the best direction that is rounding


class Sensor(NamedTuple):
    """What a filter makes of a laser.

    ``beams`` it uses of a scan, ``field_of_view`` (rad) around the heading, ``range_max`` (m) at
    and beyond which an echo is none, ``sigma`` (m) by which it takes ends of beams to lie off their
    walls, ``farthest`` (m): the largest deviation told, from which on nothing is known.
    """

    beams: int
    field_of_view: float
    range_max: float
    sigma: float
    farthest: float


@dataclass(frozen=True, eq=False)
class LocalizabilityField:
    """What a scan is worth, all over a map.

    ``deviation`` float32 ``(rows, columns, HEADINGS)`` (m): of the position, along the direction
    that the scan from the middle of the place tells least about; at most ``sensor.farthest``.
    Place (r, c) is ``spacing`` m wide, the first begins at ``origin`` (m). Places whose middle is
    not ``free`` (bool ``(rows, columns)``) have the values of the nearest that is. ``map_hash``
    says which map it is of.
    """

    deviation: NDArray[np.float32]
    free: NDArray[np.bool_]
    spacing: float
    origin: tuple[float, float]
    sensor: Sensor
    map_hash: str

    @classmethod
    def build(
        cls,
        grid: OccupancyGrid,
        cells: NDArray[np.uint8],
        sensor: Sensor,
        spacing: float = SPACING,
    ) -> LocalizabilityField:
        """The field of ``grid``, whose ``lndrl.maps.raycast.clearance`` are ``cells``; places lie
        farther apart than ``spacing`` (m) where there would be more than 60,000 of them.
        """
        width, height = grid.size
        spacing = max(spacing, math.sqrt(width * height / _MOST_PLACES))
        shape = (max(1, math.ceil(height / spacing)), max(1, math.ceil(width / spacing)))
        deviation = np.full((*shape, HEADINGS), np.nan, np.float32)
        measure_places(
            cells, grid.mapped, wall_normals(grid), grid.resolution, spacing,
            float(sensor.beams), sensor.field_of_view, sensor.range_max, sensor.sigma,
            sensor.farthest, deviation,
        )  # fmt: skip
        free = ~np.isnan(deviation[..., 0])
        return cls(
            _filled(deviation, free, sensor.farthest), free, spacing, grid.origin, sensor,
            grid_hash(grid),
        )  # fmt: skip

    def at(self, x: float, y: float, yaw: float) -> float:
        """Deviation (m) at a pose (m, rad, map frame); ``sensor.farthest`` off the map."""
        return float(
            deviation_at(
                self.deviation, 1.0 / self.spacing, *self.origin, self.sensor.farthest, x, y, yaw
            )
        )

    def towards(self, yaw: float) -> NDArray[np.float64]:
        """Deviations (m) of all places (rows, columns) for a robot that looks along ``yaw``."""
        turned = yaw / (2.0 * math.pi) * HEADINGS
        whole = math.floor(turned)
        share = turned - whole
        low = self.deviation[..., whole % HEADINGS]
        high = self.deviation[..., (whole + 1) % HEADINGS]
        between: NDArray[np.float64] = low * (1.0 - share) + high * share
        return between

    def check(self, grid: OccupancyGrid, where: str) -> None:
        """Raise UserError, naming ``where``, unless this is the field of ``grid``."""
        found = grid_hash(grid)
        if found != self.map_hash:
            raise UserError(
                f"{where}: the localizability field is of map {self.map_hash}, this place is map "
                f"{found}; build the field of this one"
            )


def grid_hash(grid: OccupancyGrid) -> str:
    """Twelve digits that tell maps apart: cells, what is unknown of them, resolution, origin."""
    digest = hashlib.sha256(repr((grid.shape, grid.resolution, grid.origin)).encode())
    digest.update(np.packbits(grid.occupied).tobytes())
    digest.update(np.packbits(grid.mapped).tobytes())
    return digest.hexdigest()[:12]


def wall_normals(grid: OccupancyGrid) -> NDArray[np.float32]:
    """Unit normals (x, y) of the walls, seen from each cell near one, ``(h, w, 2)``; else 0.

    The slope of the walls smoothed by ``SMOOTHING``: right for straight ones of any slant but
    within twice that of a corner, where it turns from one wall's to the other's.
    """
    from scipy.ndimage import gaussian_filter  # takes longer to import than a map to read

    sigma = SMOOTHING / grid.resolution
    solid = grid.mapped.astype(np.float64)
    slope = np.stack(
        [gaussian_filter(solid, sigma, order=o, mode="nearest") for o in ((0, 1), (1, 0))], axis=-1
    )
    steepness = np.hypot(slope[..., 0], slope[..., 1])[..., None]
    return np.where(steepness > 1e-6, slope / np.maximum(steepness, 1e-6), 0.0).astype(np.float32)


def _filled(
    deviation: NDArray[np.float32], free: NDArray[np.bool_], farthest: float
) -> NDArray[np.float32]:
    """Places that are not free with the values of the nearest that is."""
    if not free.any():
        return np.full_like(deviation, farthest)
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~free, return_distances=False, return_indices=True)
    filled: NDArray[np.float32] = np.ascontiguousarray(deviation[nearest[0], nearest[1]])
    return filled


@kernel()
def measure_places(
    cells, mapped, normals, resolution, spacing, beams, field_of_view, range_max, sigma, farthest,
    out,
):  # fmt: skip
    """Fill ``out`` (float32, (rows, columns, headings)) with deviations (m).

    ``cells`` and ``mapped`` (h, w), ``normals`` (h, w, 2); places whose middle is off the grid or
    in an occupied cell are left as they are. The grid's origin counts as (0, 0).
    """
    headings = out.shape[2]
    sums = np.zeros((DIRECTIONS + 1, _TERMS))
    count = min(DIRECTIONS, max(1, int(np.rint(field_of_view / (2.0 * np.pi) * DIRECTIONS))))
    weight = beams / count / (sigma * sigma)
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            x = (column + 0.5) * spacing
            y = (row + 0.5) * spacing
            r, c = int(y / resolution), int(x / resolution)
            if r >= cells.shape[0] or c >= cells.shape[1] or cells[r, c] == 0:
                continue
            look_around(cells, mapped, normals, resolution, x, y, range_max, sums)
            for heading in range(headings):
                middle = heading * DIRECTIONS // headings
                information = weight * least_information(sums, middle - count // 2, count)
                out[row, column, heading] = np.float32(
                    farthest
                    if information * farthest * farthest <= 1.0
                    else 1.0 / np.sqrt(information)
                )


@kernel()
def look_around(cells, mapped, normals, resolution, x, y, range_max, sums):
    """Running sums of J^T J over the ``DIRECTIONS`` rays from (x, y) (m) into ``sums``
    (DIRECTIONS + 1, 6): row k has those of the first k. Ray k points at (k + 1/2) steps.
    """
    rows, columns = min(cells.shape[0], mapped.shape[0]), min(cells.shape[1], mapped.shape[1])
    for k in range(min(DIRECTIONS, sums.shape[0] - 1)):
        angle = (k + 0.5) * (2.0 * np.pi / DIRECTIONS)
        dx, dy = np.cos(angle), np.sin(angle)
        for term in range(_TERMS):
            sums[k + 1, term] = sums[k, term]
        metres = cast_ray(cells, 1.0 / resolution, 0.0, 0.0, x, y, dx, dy, range_max)
        if not metres < range_max:
            continue
        behind, before = metres / resolution + _NUDGE, metres / resolution - _NUDGE
        r, c = int(y / resolution + behind * dy), int(x / resolution + behind * dx)
        if not (0 <= r < rows and 0 <= c < columns and mapped[r, c]):
            continue
        r, c = int(y / resolution + before * dy), int(x / resolution + before * dx)
        if not (0 <= r < normals.shape[0] and 0 <= c < normals.shape[1]):
            continue
        nx, ny = np.float64(normals[r, c, 0]), np.float64(normals[r, c, 1])
        turn = metres * (ny * dx - nx * dy)
        sums[k + 1, 0] += nx * nx
        sums[k + 1, 1] += nx * ny
        sums[k + 1, 2] += ny * ny
        sums[k + 1, 3] += nx * turn
        sums[k + 1, 4] += ny * turn
        sums[k + 1, 5] += turn * turn


@kernel()
def least_information(sums, first, count):
    """Of ``count`` rays from number ``first`` on, all the way round if need be: what they tell
    about the position along the worst direction when yaw is unknown too (per sigma^2).
    """
    n = sums.shape[0] - 1
    start = first % n
    end = start + count
    part = np.zeros(_TERMS)
    for term in range(_TERMS):
        part[term] = sums[min(end, n), term] - sums[start, term]
        if end > n:
            part[term] += sums[min(end - n, n), term]
    xx, xy, yy = part[0], part[1], part[2]
    total = xx + yy
    if part[5] > _NOTHING * total:
        xx -= part[3] * part[3] / part[5]
        xy -= part[3] * part[4] / part[5]
        yy -= part[4] * part[4] / part[5]
    half = 0.5 * (xx - yy)
    least = 0.5 * (xx + yy) - np.sqrt(half * half + xy * xy)
    return least if least > _NOTHING * total else 0.0


@kernel()
def deviation_at(deviation, inverse_spacing, origin_x, origin_y, farthest, x, y, yaw):
    """Deviation (m) at a pose by interpolation over place and heading; off the map ``farthest``."""
    rows, columns, headings = deviation.shape
    u = (x - origin_x) * inverse_spacing
    v = (y - origin_y) * inverse_spacing
    # Written so that NaN, too, lies off the map.
    if not (u >= 0.0 and v >= 0.0 and u <= columns and v <= rows and abs(yaw) < 1e6):
        return farthest
    u = min(max(u - 0.5, 0.0), columns - 1.0)
    v = min(max(v - 0.5, 0.0), rows - 1.0)
    c, r = int(u), int(v)
    c1, r1 = min(c + 1, columns - 1), min(r + 1, rows - 1)
    a, b = u - c, v - r
    turned = yaw / (2.0 * np.pi) * headings
    whole = np.floor(turned)
    share = turned - whole
    total = 0.0
    for side in range(2):
        k = (int(whole) + side) % headings
        low = deviation[r, c, k] * (1.0 - a) + deviation[r, c1, k] * a
        high = deviation[r1, c, k] * (1.0 - a) + deviation[r1, c1, k] * a
        between = low * (1.0 - b) + high * b
        total += between * (share if side else 1.0 - share)
    return total
