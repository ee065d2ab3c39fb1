"""What differs from the response to the empty map, cut into small patches around people."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lndrl.kernels import kernel
from lndrl.policy.sparse.points import LONGEST, POINTS, SIDE

_GROUP = 8192
"""Values at points of a group of samples, about: with 256 channels 8 MB, which a cache may hold.
The products of a whole batch would be what the learner needs most memory for."""


@dataclass(frozen=True)
class Group:
    """The patches of some samples that follow each other, as if there were no others.

    Attributes:
        sizes, rows, targets, places, ends, block_ends: as of Patches; what counts places, blocks
            and patches begins at the group's first, rows alone are those of the batch.
        starts: int64 (POINTS + 1,), where the values of each point begin.
        blocks: which blocks are its own.
    """

    sizes: NDArray[np.int32]
    rows: NDArray[np.int32]
    targets: NDArray[np.int32]
    places: NDArray[np.int32]
    ends: NDArray[np.int64]
    block_ends: NDArray[np.int64]
    starts: NDArray[np.int64]
    blocks: slice

    def points(self) -> list[tuple[int, int, int]]:
        """Points that any of its patches has, and where their values begin and end."""
        pairs = enumerate(pairwise(self.starts.tolist()))
        return [(point, begin, end) for point, (begin, end) in pairs if begin < end]


@dataclass(frozen=True)
class Patches:
    """The T patches that R rows are cut into; every row lies in exactly one.

    Samples are in G groups, one after the other: what is multiplied is as much as a group has.

    Attributes:
        sizes: int32 (T, 2), their height and width.
        rows: int32 (T, LONGEST^2), the row at cell (y, x) under LONGEST * y + x; -1 for none.
        targets: int32 (T, POINTS), the output P * block + s at (y, x) under SIDE * y + x, the first
            one cell above and left of the patch; -1 where there is none.
        places: int32 (T, POINTS), where a patch's values at a point stand among those of all
            patches and points, which are in the order of the groups, then of the points.
        starts: int64 (G, POINTS + 1), where there the values of each point begin.
        ends: int64 (N,), of each sample's patches.
        block_ends: int64 (N,), of each sample's blocks.
        group_ends: int64 (G,), of each group's samples.
    """

    sizes: NDArray[np.int32]
    rows: NDArray[np.int32]
    targets: NDArray[np.int32]
    places: NDArray[np.int32]
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    block_ends: NDArray[np.int64]
    group_ends: NDArray[np.int64]

    @property
    def most(self) -> int:
        """Values at points of the group that has most of them."""
        return int((self.starts[:, -1] - self.starts[:, 0]).max(initial=0))

    def groups(self, outputs: int) -> Iterator[Group]:
        """The groups one by one; a block has so many ``outputs``."""
        sample, patch, block = 0, 0, 0
        for end, starts in zip(self.group_ends.tolist(), self.starts, strict=True):
            samples = slice(sample, end)
            ends, block_ends = self.ends[samples], self.block_ends[samples]
            its = slice(patch, int(ends[-1]))
            blocks = slice(block, int(block_ends[-1]))
            first = int(starts[0])
            yield Group(
                self.sizes[its],
                self.rows[its],
                self.targets[its] - np.int32(outputs * block),  # those of no block stay below 0
                self.places[its] - np.int32(first),
                ends - patch,
                block_ends - block,
                starts - first,
                blocks,
            )
            sample, patch, block = end, its.stop, blocks.stop


def patches(
    cells: NDArray[np.int32],
    ends: NDArray[np.int64],
    size: int,
    pooling: int,
    blocks: NDArray[np.int32],
    block_ends: NDArray[np.int64],
) -> Patches:
    """Of rows at ``cells`` of maps of ``size`` cells a side, for outputs in ``blocks``."""
    cut = _cover(cells, ends, size, pooling, blocks, block_ends)
    sizes, rows, targets, patch_ends = cut
    group_ends = _group_ends(sizes, patch_ends)
    places, starts = _places(sizes, patch_ends[group_ends - 1])
    return Patches(sizes, rows, targets, places, starts, patch_ends, block_ends, group_ends)


def _group_ends(sizes: NDArray[np.int32], ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of as few groups as do, alike as far as whole samples allow."""
    if not len(ends):
        return np.empty(0, np.int64)
    values = np.append(0, np.cumsum((sizes + 2).prod(axis=1)))[ends]
    number = -(-max(int(values[-1]), 1) // _GROUP)
    borders = np.searchsorted(values, values[-1] * np.arange(1, number) / number) + 1
    return np.unique(np.append(borders, len(ends)))


@kernel()
def _cover(cells, ends, size, pooling, blocks, block_ends):
    """Cut the rows of each sample into patches: (sizes, rows, targets, ends).

    Rows that touch, also by a corner, are cut evenly where their bounding box is too long.
    """
    number = cells.shape[0]
    half = size // pooling
    row_at = np.full((size, size), -1, np.int32)
    block_at = np.full((half, half), -1, np.int32)
    seen = np.zeros((size, size), np.bool_)
    queue = np.empty(number, np.int32)
    sizes = np.empty((number, 2), np.int32)
    rows = np.empty((number, LONGEST * LONGEST), np.int32)
    targets = np.empty((number, POINTS), np.int32)
    patch_ends = np.empty_like(ends)
    count, begin, first_block = 0, 0, 0
    for i in range(ends.shape[0]):
        for block in range(first_block, block_ends[i]):
            block_at[blocks[block] // half, blocks[block] % half] = block
        for row in range(begin, ends[i]):
            row_at[cells[row] // size, cells[row] % size] = row
        # Not in the order of the rows: the same map shall be cut, and summed, in the same way.
        for cell in range(size * size if begin < ends[i] else 0):
            y, x = cell // size, cell % size
            if row_at[y, x] < 0:
                continue
            queue[0] = cell
            seen[y, x] = True
            head, tail = 0, 1
            top, bottom, left, right = y, y, x, x
            while head < tail:
                y, x = queue[head] // size, queue[head] % size
                head += 1
                top, bottom = min(top, y), max(bottom, y)
                left, right = min(left, x), max(right, x)
                for yy in range(max(y - 1, 0), min(y + 2, size)):
                    for xx in range(max(x - 1, 0), min(x + 2, size)):
                        if row_at[yy, xx] >= 0 and not seen[yy, xx]:
                            seen[yy, xx] = True
                            queue[tail] = yy * size + xx
                            tail += 1
            for k in range(tail):
                seen[queue[k] // size, queue[k] % size] = False
            high, wide = bottom + 1 - top, right + 1 - left
            down, across = (high + LONGEST - 1) // LONGEST, (wide + LONGEST - 1) // LONGEST
            for a in range(down):
                for b in range(across):
                    count = _cut(
                        top + high * a // down, top + high * (a + 1) // down,
                        left + wide * b // across, left + wide * (b + 1) // across,
                        row_at, block_at, pooling, sizes, rows, targets, count,
                    )  # fmt: skip
        for block in range(first_block, block_ends[i]):
            block_at[blocks[block] // half, blocks[block] % half] = -1
        begin, first_block = ends[i], block_ends[i]
        patch_ends[i] = count
    return sizes[:count], rows[:count], targets[:count], patch_ends


@kernel()
def _cut(y0, y1, x0, x1, row_at, block_at, pooling, sizes, rows, targets, count):
    """Take what rows are left in [y0, y1) x [x0, x1) as a patch; how many there are then."""
    top, bottom, left, right = y1, y0, x1, x0
    for y in range(y0, y1):
        for x in range(x0, x1):
            if row_at[y, x] >= 0:
                top, bottom = min(top, y), max(bottom, y + 1)
                left, right = min(left, x), max(right, x + 1)
    if bottom <= top:
        return count
    sizes[count, 0], sizes[count, 1] = bottom - top, right - left
    for k in range(LONGEST * LONGEST):
        rows[count, k] = -1
    for y in range(top, bottom):
        for x in range(left, right):
            rows[count, LONGEST * (y - top) + x - left] = row_at[y, x]
            row_at[y, x] = -1
    size = row_at.shape[0]
    for k in range(POINTS):
        y, x = top - 1 + k // SIDE, left - 1 + k % SIDE
        inside = y <= bottom and x <= right and 0 <= y < size and 0 <= x < size
        block = block_at[y // pooling, x // pooling] if inside else -1
        place = (y % pooling) * pooling + x % pooling
        targets[count, k] = block * pooling * pooling + place if block >= 0 else -1
    return count + 1


@kernel()
def _places(sizes, group_ends):
    """(places, starts) of ``Patches``; ``group_ends`` (G,) of each group's patches."""
    starts = np.zeros((group_ends.shape[0], POINTS + 1), np.int64)
    places = np.full((sizes.shape[0], POINTS), -1, np.int32)
    following = np.empty(POINTS, np.int64)
    begin, first = 0, 0
    for g in range(group_ends.shape[0]):
        own = starts[g]
        own[0] = first
        for t in range(begin, group_ends[g]):
            for i in range(sizes[t, 0] + 2):
                for j in range(sizes[t, 1] + 2):
                    own[SIDE * i + j + 1] += 1
        for k in range(POINTS):
            own[k + 1] += own[k]
            following[k] = own[k]
        for t in range(begin, group_ends[g]):
            for i in range(sizes[t, 0] + 2):
                for j in range(sizes[t, 1] + 2):
                    k = SIDE * i + j
                    places[t, k] = following[k]
                    following[k] += 1
        begin, first = group_ends[g], own[POINTS]
    return places, starts


KERNELS = (_cover, _places)
"""What acting calls from Python."""
