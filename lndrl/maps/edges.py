"""Exact laser fans by scan conversion: walls are drawn into the beams, not beams into the walls.

On a grid every wall is made of axis-parallel faces. From a free cell a beam's range is the nearest
of the faces it crosses that are turned towards it, so a whole fan costs one pass over the faces
within reach: both ends of a face become beam numbers, and the beams between them are shortened to
``distance / direction component``. Few faces make that many times cheaper than following rays;
``lndrl.maps.raycast`` follows rays and is the better of the two for few beams among many faces.

Kernels below take plain arrays and index them without a sign: numba counts references to members
of tuples and turns indices that may be negative into gathers, and both cost more than the work.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.kernels import kernel
from lndrl.maps.grid import OccupancyGrid

Floats32 = NDArray[np.float32]
Integers32 = NDArray[np.int32]

_BAND_METRES = 16.0  # faces are cut to it: what lies to the side of the reach is not looked at
_CHUNK = 256  # faces whose ends are computed in one go
_LEVEL = 1e-12  # direction components below it meet no face
_FACINGS = 4


class RayMap(NamedTuple):
    """What laser kernels need of a map; built once per place by ``ray_map``, never changed.

    ``cells``: the ``clearance``, uint8 ``(rows, columns)``. Faces of walls, float32 ``(F,)`` in
    whole cells: ``position`` across, ``low`` and ``high`` end along. Facing 0 is seen by beams
    towards +x (so position is x and the ends are y), 1 towards -x, 2 towards +y, 3 towards -y.
    Faces are sorted by facing, band (``band`` cells along) and position;
    ``starts[facing, band, p]`` (int32) is the first one whose position is at least p.
    ``resolution`` m; ``origin_x``, ``origin_y`` m.
    """

    cells: NDArray[np.uint8]
    position: Floats32
    low: Floats32
    high: Floats32
    starts: Integers32
    band: float
    resolution: float
    inverse_resolution: float
    origin_x: float
    origin_y: float


class FaceScratch(NamedTuple):
    """Working memory of ``scan_faces`` for up to n beams, one per thread.

    ``inverse_x``, ``inverse_y`` float32 ``(n,)``: 1 / direction component in the map frame. The
    rest belongs to the faces at hand: ``depth`` ahead, ``right`` and ``left`` end (float32, cells),
    ``first`` and ``last`` beam, ``doubt`` whether those are sure (int32).
    """

    inverse_x: Floats32
    inverse_y: Floats32
    depth: Floats32
    right: Floats32
    left: Floats32
    first: Integers32
    last: Integers32
    doubt: Integers32


def make_face_scratch(beams: int) -> FaceScratch:
    """Working memory for fans of up to ``beams`` beams."""
    inverse = np.zeros((2, beams), np.float32)
    ends = np.zeros((3, _CHUNK), np.float32)
    spans = np.zeros((3, _CHUNK), np.int32)
    return FaceScratch(inverse[0], inverse[1], *_rows(ends), *_rows(spans))


def _rows(array: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    return array[0], array[1], array[2]


def ray_map(grid: OccupancyGrid, cells: NDArray[np.uint8]) -> RayMap:
    """The grid's faces, those of neighbouring cells merged, beside its ``clearance`` ``cells``."""
    band = _band_cells(grid)
    longer = max(grid.shape)
    bands = -(-longer // band)
    faces: list[NDArray[np.int64]] = []
    starts = np.zeros((_FACINGS, bands, longer + 2), np.int32)
    count = 0
    for facing in range(_FACINGS):
        found = _faces(grid.occupied, facing, band)
        for number in range(bands):
            here = found[:, found[1] // band == number]
            starts[facing, number] = count + np.searchsorted(here[0], np.arange(longer + 2))
            count += here.shape[1]
            faces.append(here)
    position, low, high = _rows(np.concatenate(faces, axis=1).astype(np.float32))
    return RayMap(
        cells=cells,
        position=position,
        low=low,
        high=high,
        starts=starts,
        band=float(band),
        resolution=grid.resolution,
        inverse_resolution=1.0 / grid.resolution,
        origin_x=float(grid.origin[0]),
        origin_y=float(grid.origin[1]),
    )


def _band_cells(grid: OccupancyGrid) -> int:
    """Cells per band: as many equal bands over the longer side as reach ``_BAND_METRES``."""
    longer = max(grid.shape)
    bands = max(1, round(longer * grid.resolution / _BAND_METRES))
    return -(-longer // bands)


def _faces(occupied: NDArray[np.bool_], facing: int, band: int) -> NDArray[np.int64]:
    """Faces of one facing as columns [position, low, high], cut where bands meet."""
    solid = occupied.T if facing < 2 else occupied  # axis 0 is along the view
    if facing % 2 == 0:
        seen = solid[1:] & ~solid[:-1]
    else:
        seen = solid[:-1] & ~solid[1:]
    cuts = np.zeros((seen.shape[0], seen.shape[1] + 1), np.bool_)
    cuts[:, ::band] = True
    padded = np.zeros((seen.shape[0], seen.shape[1] + 2), np.bool_)
    padded[:, 1:-1] = seen
    starts = padded[:, 1:] & (~padded[:, :-1] | cuts)
    ends = padded[:, :-1] & (~padded[:, 1:] | cuts)
    position, low = np.nonzero(starts)
    _, high = np.nonzero(ends)
    return np.stack([position + 1, low, high])


@njit(inline="always", error_model="numpy")
def arctangent(y, x):
    """Angle (rad, float32) of (x, y) for x >= 0, to 1e-7: no call, so that loops vectorise."""
    size = abs(y)
    # Equal sizes go with x: (0, 0), the end of a face that the point lies on, is straight ahead.
    small = size if size <= x else x
    large = x if size <= x else size
    t = small / (large + np.float32(1e-30))
    z = t * t
    p = np.float32(-0.00405456048)
    p = p * z + np.float32(0.02186293404)
    p = p * z + np.float32(-0.05591229315)
    p = p * z + np.float32(0.09642194925)
    p = p * z + np.float32(-0.1390862864)
    p = p * z + np.float32(0.1994656547)
    p = p * z + np.float32(-0.3332986077)
    p = p * z + np.float32(0.9999993356)
    angle = p * t
    angle = angle if size <= x else np.float32(np.pi / 2) - angle
    return angle if y >= np.float32(0.0) else -angle


@kernel(_nrt=False, error_model="numpy")
def faces_in_reach(ray_map, x, y, reach):
    """How many faces ``scan_faces`` looks at from the point (cells)."""
    starts = ray_map.starts
    count = 0
    for facing in range(_FACINGS):
        across, along = (x, y) if facing < 2 else (y, x)
        low, high, first, last = _reach(starts, ray_map.band, facing, across, along, reach)
        for band in range(first, last + 1):
            count += starts[facing, band, high + 1] - starts[facing, band, low]
    return count


@kernel(_nrt=False, error_model="numpy")
def scan_faces(ray_map, x, y, yaw, fan, stride, scratch, ranges):
    """Shorten ``ranges`` (m, float32, ``(n,)``) to the walls seen from (x, y) (cells).

    The point must lie in a free cell of the grid; ``ranges[k]`` belongs to beam ``k * stride`` of
    the fan (``lndrl.world.laser.Fan``) and starts at ``range_max``.
    """
    _draw_faces(
        ray_map.position, ray_map.low, ray_map.high, ray_map.starts, ray_map.band,
        ray_map.resolution, x, y, yaw, fan.cosines, fan.sines, fan.first, fan.increment * stride,
        fan.range_max * ray_map.inverse_resolution, np.uint64(stride), scratch.inverse_x,
        scratch.inverse_y, scratch.depth, scratch.right, scratch.left, scratch.first,
        scratch.last, scratch.doubt, ranges,
    )  # fmt: skip


@kernel(_nrt=False, error_model="numpy")
def _draw_faces(
    position, low, high, starts, band_cells, resolution, x, y, yaw, cosines, sines, first_bearing,
    increment, reach, stride, inverse_x, inverse_y, depth, right, left, first, last, doubt, ranges,
):  # fmt: skip
    beams = len(ranges)
    c = np.cos(yaw)
    s = np.sin(yaw)
    _invert_directions(cosines, sines, c, s, stride, beams, inverse_x, inverse_y)
    per_radian = 1.0 / increment
    whole = 2.0 * np.pi * per_radian
    for facing in range(_FACINGS):
        across, along = (x, y) if facing < 2 else (y, x)
        sign = 1.0 if facing % 2 == 0 else -1.0
        # Counter-clockwise is +y for beams towards +x, -x for beams towards +y.
        lateral = sign if facing < 2 else -sign
        scale = np.float32(resolution * sign)
        turn = 0.5 * np.pi * (facing // 2) + np.pi * (facing % 2)
        middle = (turn - yaw - first_bearing) * per_radian
        # A facing is seen within a half circle around its middle: those turns of it that meet
        # the fan, more than one where the fan ends behind the robot.
        least = int(np.ceil((-0.25 * whole - 1.0 - middle) / whole))
        most = int(np.floor((beams + 0.25 * whole - middle) / whole))
        near, far, first_band, last_band = _reach(starts, band_cells, facing, across, along, reach)
        for band in range(first_band, last_band + 1):
            start = np.int64(starts[facing, band, near])
            end = np.int64(starts[facing, band, far + 1])
            while start < end:
                count = np.uint64(end - start if end - start < _CHUNK else _CHUNK)
                begin = np.uint64(start)
                _collect(
                    position, low, high, begin, count, across, along, sign, lateral, depth,
                    right, left,
                )  # fmt: skip
                for turns in range(least, most + 1):
                    _spans(
                        depth, right, left, count, middle + turns * whole, per_radian, beams,
                        first, last, doubt,
                    )  # fmt: skip
                    _settle(
                        position, low, high, begin, count, facing, across, along, c, s, cosines,
                        sines, stride, first, last, doubt,
                    )  # fmt: skip
                    if facing < 2:
                        _fill(first, last, depth, count, scale, inverse_x, ranges)
                    else:
                        _fill(first, last, depth, count, scale, inverse_y, ranges)
                start += np.int64(count)


@kernel(_nrt=False, error_model="numpy")
def _reach(starts, band_cells, facing, across, along, reach):
    """Positions near..far and bands first..last of one facing's faces within ``reach``."""
    last = starts.shape[2] - 2
    if facing % 2 == 0:
        near = int(across) + 1
        far = min(last, int(across + reach))
    else:
        near = max(0, int(np.ceil(across - reach)))
        far = int(across)
    first_band = max(0, int((along - reach) / band_cells))
    last_band = min(starts.shape[1] - 1, int((along + reach) / band_cells))
    return near, max(near - 1, far), first_band, last_band


@kernel(_nrt=False, error_model="numpy")
def _invert_directions(cosines, sines, c, s, stride, beams, inverse_x, inverse_y):
    """1 / direction components; float64 up to the division, for walls seen at a flat angle."""
    n = np.uint64(beams)
    if stride == 1:  # alone it vectorises
        for k in range(n):
            u = cosines[k]
            v = sines[k]
            inverse_x[k] = np.float32(1.0) / np.float32(c * u - s * v)
            inverse_y[k] = np.float32(1.0) / np.float32(s * u + c * v)
    else:
        for k in range(n):
            u = cosines[k * stride]
            v = sines[k * stride]
            inverse_x[k] = np.float32(1.0) / np.float32(c * u - s * v)
            inverse_y[k] = np.float32(1.0) / np.float32(s * u + c * v)


@kernel(_nrt=False, error_model="numpy")
def _collect(position, low, high, begin, count, across, along, sign, lateral, depth, right, left):
    """Faces from ``begin`` on as seen from the point: depth ahead, right and left end (cells)."""
    for j in range(count):
        i = begin + j
        depth[j] = np.float32((position[i] - across) * sign)
        a = np.float32((low[i] - along) * lateral)
        b = np.float32((high[i] - along) * lateral)
        right[j] = a if a < b else b
        left[j] = b if a < b else a


@kernel(_nrt=False, error_model="numpy")
def _spans(depth, right, left, count, middle, per_radian, beams, first, last, doubt):
    """First and last beam of every face, and whether an end lies too near a beam to be sure."""
    scale = np.float32(per_radian)
    offset = np.float32(middle)
    # Bound of the rounding of float32 angles (2e-7 rad) and beam numbers (up to 1.25 turns).
    margin = np.float32(1e-3 + 3e-6 * per_radian)
    top = np.float32(beams - 1)
    for i in range(count):
        a = offset + scale * arctangent(right[i], depth[i])
        b = offset + scale * arctangent(left[i], depth[i])
        begin = np.ceil(a - margin)
        end = np.floor(b + margin)
        unsure = (begin - a < margin) | (b - end < margin)
        begin = begin if begin > np.float32(0.0) else np.float32(0.0)
        begin = begin if begin < top + np.float32(1.0) else top + np.float32(1.0)
        end = end if end < top else top
        end = end if end > np.float32(-1.0) else np.float32(-1.0)
        first[i] = np.int32(begin)
        last[i] = np.int32(end)
        doubt[i] = np.int32(unsure)


@kernel(_nrt=False, error_model="numpy")
def _settle(
    position, low, high, begin, count, facing, across, along, c, s, cosines, sines, stride, first,
    last, doubt,
):  # fmt: skip
    """Test exactly the ends that ``_spans`` was not sure of."""
    sign = 1.0 if facing % 2 == 0 else -1.0
    for j in range(count):
        if doubt[j] == 0 or first[j] > last[j]:
            continue
        depth = position[begin + j] - across
        a = low[begin + j] - along
        b = high[begin + j] - along
        k = np.uint64(first[j]) * stride
        u, v = cosines[k], sines[k]
        if not _crosses(depth, a, b, facing, sign, c * u - s * v, s * u + c * v):
            first[j] += 1
        k = np.uint64(last[j]) * stride
        u, v = cosines[k], sines[k]
        if not _crosses(depth, a, b, facing, sign, c * u - s * v, s * u + c * v):
            last[j] -= 1


@kernel(_nrt=False, error_model="numpy")
def _crosses(depth, low, high, facing, sign, x, y):
    """Whether a ray along (x, y) meets the face, ends included.

    Two faces that share a corner compute the same products for it: nothing slips between them.
    """
    forward, sideways = (x, y) if facing < 2 else (y, x)
    forward *= sign
    at = depth * sign * sideways
    return forward > _LEVEL and low * forward <= at and at <= high * forward


@kernel(_nrt=False, error_model="numpy")
def _fill(first, last, depth, count, scale, inverse, ranges):
    for j in range(count):
        if last[j] < first[j]:
            continue
        metres = depth[j] * scale
        begin = np.uint64(first[j])
        for q in range(np.uint64(last[j] - first[j] + 1)):
            k = begin + q
            at = metres * inverse[k]
            ranges[k] = at if at < ranges[k] else ranges[k]
