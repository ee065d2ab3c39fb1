"""Which outputs of the pedestrian-map encoder can differ from its response to an empty map.

The pedestrian map is almost empty: two to four discs of about 16 cells in 2,304. A convolution's
output differs from its response to the empty map only where its receptive field touches a
pedestrian. This module lists those outputs for a batch, layer by layer, as gather indices; the
sparse encoder evaluates only them. The empty-map response itself is translation invariant away
from the borders, so a handful of *background rows* stands for all other outputs: they are rows
like any other, evaluated and differentiated with the rest. The result is the dense network's, up
to the order of floating-point sums.

Every table starts with its background rows; the active rows of all samples follow. An index of
-1 is the zero padding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.config import TaskConfig
from lndrl.navigation import Observation
from lndrl.navigation.pedestrian_map import paint

# Background classes per axis: how many rows at each border differ from the interior.
# Convolution 1 sees zeros everywhere: one class. Each later level adds a border of its own.
_CLASSES_CONV2 = 3  # first row, interior, last row
_CLASSES_POOL2 = 3
_CLASSES_CONV3 = 5  # two rows at each end
_CLASSES_POOL3 = 3
SMALLEST_MAP = 40  # cells per side below which the classes of opposite borders would overlap


@dataclass(frozen=True)
class MapStructure:
    """Gather indices of one batch of N samples (C-contiguous, ready for the sparse encoder).

    Attributes:
        patches: float32 (rows1, 27) inputs of convolution 1, channel-major 3x3 windows.
        pool1: int32 (rows, 4) into convolution 1's outputs.
        conv2: int32 (rows, 9) into pool1's outputs, row-major 3x3 windows.
        pool2, conv3, pool3: likewise, one level further.
        features: int32 (N, cells of the last map) into pool3's outputs.
    """

    patches: NDArray[np.float32]
    pool1: NDArray[np.int32]
    conv2: NDArray[np.int32]
    pool2: NDArray[np.int32]
    conv3: NDArray[np.int32]
    pool3: NDArray[np.int32]
    features: NDArray[np.int32]


def map_structure(observation: Observation, task: TaskConfig) -> MapStructure:
    """Structure of a batch of observations with leading shape (N,).

    Raises ValueError when the map is too small for the sparse evaluation (see SMALLEST_MAP) or
    not divisible by 8.
    """
    if task.map_cells < SMALLEST_MAP or task.map_cells % 8:
        raise ValueError(f"a map of {task.map_cells} cells has no sparse evaluation")
    return MapStructure(
        *_structure(
            observation.pedestrians,
            observation.pedestrian_count,
            task.map_cells,
            task.map_extent,
            task.pedestrian_radius,
        )
    )


@njit(cache=True, nogil=True)
def _class3(i, size):
    return 0 if i == 0 else (2 if i == size - 1 else 1)


@njit(cache=True, nogil=True)
def _class5(i, size):
    if i < 2:
        return i
    if i >= size - 2:
        return 5 - (size - i)
    return 2


# Loops instead of slices below: numba takes seconds to compile an assignment to a slice.


@njit(cache=True, nogil=True)
def _grow(rows, needed):
    """``rows`` with room for ``needed`` rows, contents kept."""
    if needed <= rows.shape[0]:
        return rows
    larger = np.empty((max(needed, 2 * rows.shape[0]), rows.shape[1]), rows.dtype)
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            larger[i, j] = rows[i, j]
    return larger


@njit(cache=True, nogil=True)
def _clear(index):
    for y in range(index.shape[0]):
        for x in range(index.shape[1]):
            index[y, x] = -1


@njit(cache=True, nogil=True)
def _dilate(cells, n_cells, size, index, first, out):
    """Mark every position within one cell of ``cells``; numbers them from ``first`` in ``index``.

    ``index`` must be -1 everywhere; ``out`` receives the marked positions; returns their count.
    """
    count = 0
    for k in range(n_cells):
        y, x = cells[k] // size, cells[k] % size
        for yy in range(max(y - 1, 0), min(y + 2, size)):
            for xx in range(max(x - 1, 0), min(x + 2, size)):
                if index[yy, xx] < 0:
                    index[yy, xx] = first + count
                    out[count] = yy * size + xx
                    count += 1
    return count


@njit(cache=True, nogil=True)
def _pooled(cells, n_cells, size, index, first, out):
    """Number the 2x2 blocks that contain any of ``cells``; as ``_dilate``."""
    half = size // 2
    count = 0
    for k in range(n_cells):
        y, x = (cells[k] // size) // 2, (cells[k] % size) // 2
        if index[y, x] < 0:
            index[y, x] = first + count
            out[count] = y * half + x
            count += 1
    return count


@njit(cache=True, nogil=True)
def _background_rows(patches, pool1, conv2, pool2, conv3, pool3):
    """Fill the background rows: one per class of position."""
    for k in range(27):
        patches[0, k] = 0.0
    for k in range(4):
        pool1[0, k] = 0
    for cy in range(3):
        for cx in range(3):
            for k in range(9):
                y, x = cy + k // 3 - 1, cx + k % 3 - 1
                # Class 0 looks over the low border, class 2 over the high one.
                outside = y < 0 or x < 0 or y > 2 or x > 2
                conv2[cy * 3 + cx, k] = -1 if outside else 0
            for k in range(4):
                # Pooled class 0 holds rows {0, 1}, class 2 the last two, class 1 interior ones.
                y = (k // 2) if cy == 0 else (1 + (k // 2) if cy == 2 else 1)
                x = (k % 2) if cx == 0 else (1 + (k % 2) if cx == 2 else 1)
                pool2[cy * 3 + cx, k] = y * 3 + x
                y5 = (k // 2) if cy == 0 else (3 + (k // 2) if cy == 2 else 2)
                x5 = (k % 2) if cx == 0 else (3 + (k % 2) if cx == 2 else 2)
                pool3[cy * 3 + cx, k] = y5 * 5 + x5
    for cy in range(5):
        for cx in range(5):
            for k in range(9):
                # On a 5x5 stand-in map whose only interior row is 2, pooled classes follow.
                y, x = cy + k // 3 - 1, cx + k % 3 - 1
                outside = y < 0 or x < 0 or y > 4 or x > 4
                conv3[cy * 5 + cx, k] = -1 if outside else _class3(y, 5) * 3 + _class3(x, 5)


@njit(cache=True, nogil=True)
def _structure(pedestrians, counts, size, extent, radius):
    n = counts.shape[0]
    s2, s3, s4 = size // 2, size // 4, size // 8
    image = np.zeros((3, size, size), np.float32)
    index1 = np.empty((size, size), np.int32)
    block1 = np.empty((s2, s2), np.int32)
    index2 = np.empty((s2, s2), np.int32)
    block2 = np.empty((s3, s3), np.int32)
    index3 = np.empty((s3, s3), np.int32)
    block3 = np.empty((s4, s4), np.int32)
    painted = np.empty(size * size, np.int32)
    cells = np.empty(size * size, np.int32)
    blocks = np.empty(size * size, np.int32)

    patches = np.empty((64 * n + 64, 27), np.float32)
    pool1 = np.empty((24 * n + 64, 4), np.int32)
    conv2 = np.empty((48 * n + 64, 9), np.int32)
    pool2 = np.empty((20 * n + 64, 4), np.int32)
    conv3 = np.empty((40 * n + 64, 9), np.int32)
    pool3 = np.empty((16 * n + 64, 4), np.int32)
    features = np.empty((n, s4 * s4), np.int32)
    _background_rows(patches, pool1, conv2, pool2, conv3, pool3)
    r1, b1, r2, b2, r3, b3 = 1, 1, 9, 9, 25, 9

    for i in range(n):
        _clear(block3)
        if counts[i] > 0:
            paint(pedestrians[i], counts[i], size, extent, radius, image)
            n_painted = _occupied(image, painted)
            _clear(index1)
            _clear(block1)
            _clear(index2)
            _clear(block2)
            _clear(index3)
            count = _dilate(painted, n_painted, size, index1, r1, cells)
            patches = _add_patches(cells, count, size, image, patches, r1)
            r1 += count
            pool1, b1, n_blocks = _add_blocks(
                cells, count, size, index1, block1, pool1, b1, 1, blocks
            )
            conv2, r2, count = _add_conv(blocks, n_blocks, s2, block1, index2, conv2, r2, 1, cells)
            pool2, b2, n_blocks = _add_blocks(
                cells, count, s2, index2, block2, pool2, b2, 3, blocks
            )
            conv3, r3, count = _add_conv(blocks, n_blocks, s3, block2, index3, conv3, r3, 3, cells)
            pool3, b3, n_blocks = _add_blocks(
                cells, count, s3, index3, block3, pool3, b3, 5, blocks
            )
        for y in range(s4):
            for x in range(s4):
                active = block3[y, x]
                background = _class3(y, s4) * 3 + _class3(x, s4)
                features[i, y * s4 + x] = active if active >= 0 else background
    return patches[:r1], pool1[:b1], conv2[:r2], pool2[:b2], conv3[:r3], pool3[:b3], features


@njit(cache=True, nogil=True)
def _occupied(image, cells):
    """List the cells where somebody stands; returns their count."""
    size = image.shape[1]
    count = 0
    for y in range(size):
        for x in range(size):
            if image[0, y, x] != 0.0:
                cells[count] = y * size + x
                count += 1
    return count


@njit(cache=True, nogil=True)
def _add_patches(cells, count, size, image, patches, first):
    """Convolution 1's windows themselves: its input has no gradient and needs no table."""
    patches = _grow(patches, first + count)
    for c in range(count):
        y, x = cells[c] // size, cells[c] % size
        for channel in range(3):
            for k in range(9):
                yy, xx = y + k // 3 - 1, x + k % 3 - 1
                inside = 0 <= yy < size and 0 <= xx < size
                patches[first + c, channel * 9 + k] = image[channel, yy, xx] if inside else 0.0
    return patches


@njit(cache=True, nogil=True)
def _add_blocks(cells, count, size, index, block, pool, first, classes, blocks):
    """Append the pooled blocks that hold any of ``cells``; background as ``classes`` per axis."""
    n_blocks = _pooled(cells, count, size, block, first, blocks)
    pool = _grow(pool, first + n_blocks)
    half = size // 2
    for b in range(n_blocks):
        y, x = 2 * (blocks[b] // half), 2 * (blocks[b] % half)
        for k in range(4):
            yy, xx = y + k // 2, x + k % 2
            active = index[yy, xx]
            if active >= 0:
                pool[first + b, k] = active
            elif classes == 1:
                pool[first + b, k] = 0
            elif classes == 3:
                pool[first + b, k] = _class3(yy, size) * 3 + _class3(xx, size)
            else:
                pool[first + b, k] = _class5(yy, size) * 5 + _class5(xx, size)
    return pool, first + n_blocks, n_blocks


@njit(cache=True, nogil=True)
def _add_conv(blocks, n_blocks, size, block, index, conv, first, classes, cells):
    """Append the convolution outputs that touch any of ``blocks``; background as above."""
    count = _dilate(blocks, n_blocks, size, index, first, cells)
    conv = _grow(conv, first + count)
    for c in range(count):
        y, x = cells[c] // size, cells[c] % size
        for k in range(9):
            yy, xx = y + k // 3 - 1, x + k % 3 - 1
            if yy < 0 or xx < 0 or yy >= size or xx >= size:
                conv[first + c, k] = -1
            elif block[yy, xx] >= 0:
                conv[first + c, k] = block[yy, xx]
            elif classes == 1:
                conv[first + c, k] = 0
            else:
                conv[first + c, k] = _class3(yy, size) * 3 + _class3(xx, size)
    return conv, first + count, count
