"""The pedestrian map: a picture of the people around the robot, drawn by one function for all.

Channel 0 is 1 where a person stands, channels 1 and 2 hold that person's velocity along the
robot's x and y axes in m/s (rotated only, the robot's own velocity is not subtracted). Row 0 is
the far end ahead, column 0 the far end to the left. A cell belongs to a person when its centre
lies within the drawn radius of the person's centre; people come near to far and the later, so
farther, person overwrites. Sources: PAPER (state space), GROUP (parameters §4.3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.config import TaskConfig
from lndrl.kernels import kernel


@kernel()
def _disc_cells(x, y, cells, extent, radius, found):
    """Flat indices (row * cells + column) of the cells within ``radius`` of (x, y).

    Writes them to ``found`` and returns how many; none when the centre is out of view.
    """
    half = 0.5 * extent
    if not (abs(x) <= half and abs(y) <= half):
        return 0
    size = extent / cells
    # One cell of margin on each side: the exact test below decides, not the rounding here.
    row_first = max(0, int(np.floor((half - x - radius) / size)) - 1)
    row_last = min(cells - 1, int(np.floor((half - x + radius) / size)) + 1)
    column_first = max(0, int(np.floor((half - y - radius) / size)) - 1)
    column_last = min(cells - 1, int(np.floor((half - y + radius) / size)) + 1)
    limit = radius * radius
    number = 0
    for row in range(row_first, row_last + 1):
        dx = half - (row + 0.5) * size - x
        for column in range(column_first, column_last + 1):
            dy = half - (column + 0.5) * size - y
            if dx * dx + dy * dy <= limit:
                found[number] = row * cells + column
                number += 1
    return number


@kernel()
def _paint(pedestrians, count, cells, extent, radius, out, found):
    out[:] = 0.0
    for i in range(min(count, pedestrians.shape[0])):
        number = _disc_cells(
            float(pedestrians[i, 0]), float(pedestrians[i, 1]), cells, extent, radius, found
        )
        for k in range(number):
            row = found[k] // cells
            column = found[k] % cells
            out[0, row, column] = 1.0
            out[1, row, column] = pedestrians[i, 2]
            out[2, row, column] = pedestrians[i, 3]


@kernel()
def _paint_many(pedestrians, count, cells, extent, radius, out):
    found = np.empty(cells * cells, np.int32)
    for n in range(pedestrians.shape[0]):
        _paint(pedestrians[n], int(count[n]), cells, extent, radius, out[n], found)


@kernel()
def collect_many(pedestrians, count, cells, extent, radius, offsets, cell, velocity):
    """See ``pedestrian_cells``, which makes room for what is written here; returns how much is."""
    found = np.empty(cells * cells, np.int32)
    place = np.full(cells * cells, -1, np.int64)  # where in the list a cell stands
    total = 0
    for n in range(pedestrians.shape[0]):
        begin = total
        for i in range(min(int(count[n]), pedestrians.shape[1])):
            number = _disc_cells(
                float(pedestrians[n, i, 0]),
                float(pedestrians[n, i, 1]),
                cells,
                extent,
                radius,
                found,
            )
            for k in range(number):
                where = place[found[k]]
                if where < 0:
                    where = total
                    place[found[k]] = where
                    cell[where] = found[k]
                    total += 1
                velocity[where, 0] = pedestrians[n, i, 2]
                velocity[where, 1] = pedestrians[n, i, 3]
        for k in range(begin, total):
            place[cell[k]] = -1
        offsets[n + 1] = total
    return total


def draw_pedestrian_map(
    pedestrians: NDArray[np.float32],
    count: NDArray[np.uint8],
    task: TaskConfig,
    out: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Draw maps (..., 3, cells, cells) of people (..., P, 4): x, y, vx, vy in the robot frame.

    ``count`` (...) says how many rows of each sample are valid. ``out`` is reused when given; it
    must be C-contiguous float32 of the result's shape.
    """
    lead = pedestrians.shape[:-2]
    cells = task.map_cells
    if out is None:
        out = np.empty((*lead, 3, cells, cells), np.float32)
    if not out.flags.c_contiguous:
        raise ValueError("out must be C-contiguous, or the maps would go into a copy")
    flat = out.reshape(-1, 3, cells, cells)
    _paint_many(
        np.ascontiguousarray(pedestrians).reshape(-1, *pedestrians.shape[-2:]),
        np.ascontiguousarray(count).reshape(-1),
        cells,
        task.map_extent,
        task.pedestrian_radius,
        flat,
    )
    return out


def pedestrian_cells(
    pedestrians: NDArray[np.float32], count: NDArray[np.uint8], task: TaskConfig
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]:
    """The same maps as lists of occupied cells, for encoders that skip the empty ones.

    ``pedestrians`` (N, P, 4) and ``count`` (N). Returns ``offsets`` (N + 1) into the lists,
    ``cell`` (K) as row * cells + column, each cell at most once per sample, and ``velocity``
    (K, 2): the values of channels 1 and 2 there (channel 0 is 1).
    """
    cells = task.map_cells
    per_person = min(
        cells * cells, (int(2.0 * task.pedestrian_radius * cells / task.map_extent) + 2) ** 2
    )
    capacity = max(1, int(count.sum(dtype=np.int64)) * per_person)
    offsets = np.zeros(len(pedestrians) + 1, np.int64)
    cell = np.empty(capacity, np.int32)
    velocity = np.empty((capacity, 2), np.float32)
    total = collect_many(
        np.ascontiguousarray(pedestrians),
        np.ascontiguousarray(count),
        cells,
        task.map_extent,
        task.pedestrian_radius,
        offsets,
        cell,
        velocity,
    )
    return offsets, cell[:total], velocity[:total]
