"""Where the response to a pedestrian map differs from the response to an empty one.

The pedestrian map is almost empty: two to four discs of about 16 cells in 2,304. An output of the
encoder differs from its response to the empty map only where its receptive field touches a
pedestrian. This module lists, for a batch and layer by layer, the outputs that can differ and the
rows that feed them; the sparse encoder carries only their differences.

The response to the empty map does not depend on the position away from the borders, so that of
the smallest map that has an interior, the *stand-in*, holds every value that a larger one has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.config import TaskConfig
from lndrl.kernels import kernel
from lndrl.navigation import Observation
from lndrl.navigation.pedestrian_map import pedestrian_cells
from lndrl.policy.sparse.patches import Patches, patches

STAND_IN = {2: 24, 1: 6}
"""Cells per side of the stand-in by pooling. Every convolution moves the borders' influence one
cell inwards; a first, an interior and a last value must be left after three of them."""

LEVELS = 3
IntArray = NDArray[np.int32]


@dataclass(frozen=True)
class Level:
    """A 3x3 convolution with ReLU and pooling, on R rows that may differ, for B pooled blocks.

    Rows and blocks are those of all samples, in their order. A block has P outputs, 4 with 2x2
    pooling and 1 without.

    Attributes:
        stand_in: int32 (B, P + 1), places in the stand-in: of the outputs before pooling, then
            of the block after it, row-major.
        taps: int32 (B, P * 9), the input row under tap k of a block's output s at 9 * s + k;
            -1 where nothing differs. Taps and the outputs of a block are row-major.
        patches: the rows cut into patches where those are cheaper; then nobody follows taps, and
            they are empty.
    """

    stand_in: IntArray
    taps: IntArray
    patches: Patches | None = None


@dataclass(frozen=True)
class MapStructure:
    """Structure of a batch of N pedestrian maps.

    Attributes:
        samples: N.
        values: float32 (R, 3), the map's channels where somebody stands.
        levels: the three convolutions; the first reads ``values``.
        order: int64 (B + cells,), the last level's blocks cell by cell; each cell begins with
            its empty response, B + cell.
        starts: int64 (cells + 1,), where in ``order`` a cell begins.
        sample: int64 (B + cells,), the sample of each entry of ``order``; N for empty responses.
        cell_stand_in: int64 (cells,), place of each cell of the last map in the stand-in.
    """

    samples: int
    values: NDArray[np.float32]
    levels: tuple[Level, ...]
    order: NDArray[np.int64]
    starts: NDArray[np.int64]
    sample: NDArray[np.int64]
    cell_stand_in: NDArray[np.int64]


def map_structure(
    observation: Observation, task: TaskConfig, pooling: int = 2, exact: bool = True
) -> MapStructure:
    """Structure of observations (N,) for convolutions pooled by ``pooling`` (2, or 1 for none).

    ``exact``: for products in float32; bfloat16's would suffer in patches.
    Raises ValueError when the map is smaller than the stand-in, or cannot be halved three times.
    """
    cells = pedestrian_cells(observation.pedestrians, observation.pedestrian_count, task)
    return _structure(*cells, task.map_cells, pooling, exact)


def drawn_structure(maps: NDArray[np.float32], pooling: int = 2) -> MapStructure:
    """``map_structure`` of the same maps as they were drawn, (N, 3, size, size)."""
    samples, _, size, _ = maps.shape
    flat = maps.reshape(samples, 3, size * size)
    sample, cell = np.nonzero(flat[:, 0])
    offsets = np.searchsorted(sample, np.arange(samples + 1))
    velocity = np.stack([flat[sample, 1, cell], flat[sample, 2, cell]], axis=1)
    return _structure(offsets, cell.astype(np.int32), velocity, size, pooling, True)


def _structure(
    offsets: NDArray[np.int64],
    cells: IntArray,
    velocity: NDArray[np.float32],
    size: int,
    pooling: int,
    exact: bool,
) -> MapStructure:
    """Of N maps of ``size`` cells a side; the lists are those of ``pedestrian_cells``."""
    small = STAND_IN[pooling]
    if size < small or size % pooling**LEVELS:
        raise ValueError(f"a map of {size} cells has no sparse evaluation")
    values = np.ones((len(cells), 3), np.float32)
    values[:, 1:] = velocity
    ends = offsets[1:]
    levels = []
    for i in range(LEVELS):
        # Of three channels the products are the least of it.
        cut = exact and i > 0
        taps, stand_in, blocks, block_ends = _level(cells, ends, size, small, pooling, not cut)
        found = patches(cells, ends, size, pooling, blocks, block_ends) if cut else None
        levels.append(Level(stand_in, taps, found))
        cells, ends = blocks, block_ends
        size, small = size // pooling, small // pooling
    order, starts, sample = _by_cell(cells, ends, size * size)
    return MapStructure(
        len(offsets) - 1,
        values,
        tuple(levels),
        order,
        starts,
        sample,
        stand_in_cells(size, pooling),
    )


def stand_in_cells(size: int, pooling: int) -> NDArray[np.int64]:
    """Where each cell (row-major) of a last map of ``size`` stands in the stand-in's last map."""
    small = STAND_IN[pooling] // pooling**LEVELS
    side = np.arange(size)
    near = np.array([_in_stand_in(i, 0, size, small) // small for i in side])
    return (near[:, None] * small + near[None, :]).reshape(-1)


@kernel()
def _in_stand_in(y, x, size, small):
    """The place in a stand-in of ``small`` x ``small`` that sees what (y, x) of ``size`` sees."""
    half = small // 2
    yy = y if y < half else (small - (size - y) if y >= size - half else half)
    xx = x if x < half else (small - (size - x) if x >= size - half else half)
    return yy * small + xx


@kernel()
def _level(cells, ends, size, small, pooling, taps_too):
    """The arrays of a Level on a map of ``size``, whose rows that may differ lie at ``cells``.

    ``ends`` (N,) of each sample's rows, ``small`` cells per side of the stand-in. Returns (taps,
    stand_in, cells of the blocks, ends of each sample's blocks); without ``taps_too`` there are no
    taps.
    """
    half, small_half = size // pooling, small // pooling
    outputs = pooling * pooling
    rows = cells.shape[0]
    # What the nine taps of a row can reach.
    most = rows * (4 if pooling == 2 else 9)
    row_at = np.full((size, size), -1, np.int32)
    block_at = np.full((half, half), -1, np.int32)
    taps = np.empty((most if taps_too else 0, 9 * outputs), np.int32)
    stand_in = np.empty((most, outputs + 1), np.int32)
    blocks = np.empty(most, np.int32)
    block_ends = np.empty_like(ends)
    count, begin = 0, 0
    for i in range(ends.shape[0]):
        first = count
        for row in range(begin, ends[i]):
            y, x = cells[row] // size, cells[row] % size
            row_at[y, x] = row
            for k in range(9):
                yy, xx = y + 1 - k // 3, x + 1 - k % 3
                if yy < 0 or xx < 0 or yy >= size or xx >= size:
                    continue
                by, bx = yy // pooling, xx // pooling
                if block_at[by, bx] < 0:
                    block_at[by, bx] = count
                    blocks[count] = by * half + bx
                    count += 1
        for block in range(first, count):
            by, bx = blocks[block] // half, blocks[block] % half
            block_at[by, bx] = -1
            for s in range(outputs):
                y, x = pooling * by + s // pooling, pooling * bx + s % pooling
                stand_in[block, s] = _in_stand_in(y, x, size, small)
                for k in range(9 if taps_too else 0):
                    yy, xx = y + k // 3 - 1, x + k % 3 - 1
                    inside = 0 <= yy < size and 0 <= xx < size
                    taps[block, 9 * s + k] = row_at[yy, xx] if inside else -1
            stand_in[block, outputs] = _in_stand_in(by, bx, half, small_half)
        for row in range(begin, ends[i]):
            row_at[cells[row] // size, cells[row] % size] = -1
        begin = ends[i]
        block_ends[i] = count
    return taps[:count], stand_in[:count], blocks[:count], block_ends


@kernel()
def _by_cell(blocks, ends, cells):
    """Blocks sorted by cell (stable), as ``order``, ``starts`` and ``sample`` of MapStructure."""
    starts = np.zeros(cells + 1, np.int64)
    for block in blocks:
        starts[block + 1] += 1
    number, samples = blocks.shape[0], ends.shape[0]
    order = np.empty(number + cells, np.int64)
    sample = np.empty(number + cells, np.int64)
    place = np.empty(cells, np.int64)
    for cell in range(cells):
        starts[cell + 1] += starts[cell] + 1
        order[starts[cell]] = number + cell
        sample[starts[cell]] = samples
        place[cell] = starts[cell] + 1
    b = 0
    for i in range(samples):
        while b < ends[i]:
            cell = blocks[b]
            order[place[cell]] = b
            sample[place[cell]] = i
            place[cell] += 1
            b += 1
    return order, starts, sample


KERNELS = (_in_stand_in, _level, _by_cell)
"""What acting calls from Python."""
