"""A map from scans at known poses: counted hits and passes per cell (Moravec and Elfes's idea)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lndrl.maps.grid import OccupancyGrid

Floats = NDArray[np.float64]

OCCUPIED = 0.25
"""Share of the beams in a cell that must end there (gmapping's occ_thresh)."""
_BORDER = 1.0  # m around the farthest thing seen
_FARTHEST = 30.0  # m; what lies beyond is seen by few beams, far apart


def survey(
    poses: Floats,
    ranges: Sequence[NDArray[np.float32]] | NDArray[np.float32],
    bearings: NDArray[np.float32],
    farthest: float,
    resolution: float = 0.05,
) -> OccupancyGrid:
    """The grid that scans ``(n, beams)`` m at ``poses`` (n, 3) show.

    A cell is occupied where at least ``OCCUPIED`` of the beams in it end, free where others pass,
    and unknown where none came. Readings at or beyond ``farthest`` (m) or 30 m, and those that are
    not above 0, show nothing.
    """
    limit = min(farthest, _FARTHEST)
    ends, seen = [], []
    for pose, scan in zip(poses, ranges, strict=True):
        usable = np.isfinite(scan) & (scan > 0.0) & (scan < limit)
        angle = pose[2] + bearings[usable].astype(np.float64)
        reach = scan[usable].astype(np.float64)[:, np.newaxis]
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ends.append(pose[:2] + reach * direction)
        seen.append((pose[:2], direction, reach))
    every = np.concatenate([*ends, poses[:, :2]])
    low = np.floor((every.min(axis=0) - _BORDER) / resolution) * resolution
    columns, rows = np.ceil((every.max(axis=0) + _BORDER - low) / resolution).astype(int)
    hits = np.zeros(rows * columns, dtype=np.int32)
    passes = np.zeros(rows * columns, dtype=np.int32)
    for end, (start, direction, reach) in zip(ends, seen, strict=True):
        np.add.at(hits, _cells(end, low, resolution, columns), 1)
        along = np.arange(0.0, limit, resolution)[: int(limit / resolution) + 1]
        # Half a cell before the end: what ends in a cell does not pass it.
        short = along < reach - 0.75 * resolution
        beam, step = np.nonzero(short)
        points = start + direction[beam] * along[step][:, np.newaxis]
        np.add.at(passes, _cells(points, low, resolution, columns), 1)
    both = hits + passes
    solid = (hits > 0) & (hits >= OCCUPIED * both)
    unknown = (both == 0).reshape(rows, columns)
    return OccupancyGrid(
        solid.reshape(rows, columns) | unknown,
        resolution,
        (float(low[0]), float(low[1])),
        unknown,
    )


def _cells(
    points: Floats, low: NDArray[np.float64], resolution: float, columns: int
) -> NDArray[np.int64]:
    index = ((points - low) / resolution).astype(np.int64)
    cells: NDArray[np.int64] = index[:, 1] * columns + index[:, 0]
    return cells
