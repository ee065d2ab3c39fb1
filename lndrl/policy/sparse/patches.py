"""Convolutions evaluated patch by patch, at points (see ``points``), with gradients.

What differs from the response to the empty map lies in small patches around people. ``cover`` cuts
them out; a compiled kernel takes them to the points, one matrix product per point multiplies all
patches of a batch that have it, another kernel takes the products back, adds the response to the
empty map and pools.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd import Function

from lndrl.kernels import kernel
from lndrl.policy.sparse.points import (
    LONGEST,
    POINTS,
    SIDE,
    evaluation,
    interpolation,
    kernel_evaluation,
)
from lndrl.policy.sparse.rows import NONE, spread_empty

if TYPE_CHECKING:
    from lndrl.policy.sparse.structure import Level

_EVALUATION, _INTERPOLATION = evaluation(), interpolation()


@dataclass(frozen=True)
class Patches:
    """The T patches that R rows are cut into; every row lies in exactly one.

    Attributes:
        sizes: int32 (T, 2), their height and width.
        rows: int32 (T, LONGEST^2), the row at cell (y, x) under LONGEST * y + x; -1 for none.
        targets: int32 (T, POINTS), the output P * block + s at (y, x) under SIDE * y + x, the first
            one cell above and left of the patch; -1 where there is none.
        places: int32 (T, POINTS), where a patch's values at a point stand among those of all
            patches and points, which are in the order of the points.
        starts: int64 (POINTS + 1,), where there the values of each point begin.
        ends: int64 (N,), of each sample's patches.
        block_ends: int64 (N,), of each sample's blocks.
    """

    sizes: NDArray[np.int32]
    rows: NDArray[np.int32]
    targets: NDArray[np.int32]
    places: NDArray[np.int32]
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    block_ends: NDArray[np.int64]


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
    places, starts = _places(sizes)
    return Patches(sizes, rows, targets, places, starts, patch_ends, block_ends)


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
def _places(sizes):
    """(places, starts) of ``Patches``."""
    starts = np.zeros(POINTS + 1, np.int64)
    for t in range(sizes.shape[0]):
        for i in range(sizes[t, 0] + 2):
            for j in range(sizes[t, 1] + 2):
                starts[SIDE * i + j + 1] += 1
    for k in range(POINTS):
        starts[k + 1] += starts[k]
    following = starts[:-1].copy()
    places = np.full((sizes.shape[0], POINTS), -1, np.int32)
    for t in range(sizes.shape[0]):
        for i in range(sizes[t, 0] + 2):
            for j in range(sizes[t, 1] + 2):
                k = SIDE * i + j
                places[t, k] = following[k]
                following[k] += 1
    return places, starts


@kernel()
def _reached(rows, live, y, x):
    """Whether a row of a patch that is not zero counts for its output at (y, x).

    Elsewhere products leave what rounding makes of nothing, and ReLU could take that for something.
    """
    for yy in range(max(y - 2, 0), min(y + 1, LONGEST)):
        for xx in range(max(x - 2, 0), min(x + 1, LONGEST)):
            row = rows[LONGEST * yy + xx]
            if row >= 0 and live[row]:
                return True
    return False


@kernel(error_model="numpy", fastmath={"contract"})
def _to_points(rows, cut, sizes, places, evaluation, scratch, out, live):
    """out[place] = the values of a patch at a point; scratch (LONGEST * SIDE, C).

    live[row] says whether a row is anything but zero.
    """
    channels = rows.shape[1]
    for row in range(rows.shape[0]):
        live[row] = False
        for c in range(channels):
            if rows[row, c] != 0.0:
                live[row] = True
                break
    for t in range(sizes.shape[0]):
        high, wide = sizes[t, 0], sizes[t, 1]
        for y in range(high):
            for j in range(wide + 2):
                for c in range(channels):
                    scratch[SIDE * y + j, c] = 0.0
            for x in range(wide):
                row = cut[t, LONGEST * y + x]
                if row >= 0:
                    for j in range(wide + 2):
                        e = evaluation[wide, j, x]
                        if e != 0.0:
                            for c in range(channels):
                                scratch[SIDE * y + j, c] += e * rows[row, c]
        for i in range(high + 2):
            for j in range(wide + 2):
                place = places[t, SIDE * i + j]
                e = evaluation[high, i, 0]
                for c in range(channels):
                    out[place, c] = e * scratch[j, c]
                for y in range(1, high):
                    e = evaluation[high, i, y]
                    if e != 0.0:
                        for c in range(channels):
                            out[place, c] += e * scratch[SIDE * y + j, c]


@kernel(error_model="numpy", fastmath={"contract"})
def _to_rows(values, cut, sizes, places, evaluation, scratch, out):
    """The gradient of ``_to_points`` by its rows: out[row]."""
    channels = values.shape[1]
    for t in range(sizes.shape[0]):
        high, wide = sizes[t, 0], sizes[t, 1]
        for y in range(high):
            for j in range(wide + 2):
                for c in range(channels):
                    scratch[SIDE * y + j, c] = 0.0
                for i in range(high + 2):
                    e = evaluation[high, i, y]
                    if e != 0.0:
                        place = places[t, SIDE * i + j]
                        for c in range(channels):
                            scratch[SIDE * y + j, c] += e * values[place, c]
            for x in range(wide):
                row = cut[t, LONGEST * y + x]
                if row >= 0:
                    for c in range(channels):
                        out[row, c] = 0.0
                    for j in range(wide + 2):
                        e = evaluation[wide, j, x]
                        if e != 0.0:
                            for c in range(channels):
                                out[row, c] += e * scratch[SIDE * y + j, c]


@kernel(error_model="numpy", fastmath={"contract"})
def _pool(
    products, cut, live, sizes, places, targets, ends, block_ends, interpolation, stand_in,
    conv_empty, pool_empty, scratch, sums, out, winner,
):  # fmt: skip
    """out[b] = relu(max over outputs s of a block) - pool_empty; winner[b] = the s that won.

    An output is conv_empty plus what ``products`` of the patches over it are back in the plane;
    scratch (SIDE^2, O), sums (outputs of a sample at most, O).
    """
    outputs, channels = stand_in.shape[1] - 1, out.shape[1]
    first, begin = 0, 0
    for n in range(ends.shape[0]):
        for b in range(first, block_ends[n]):
            for s in range(outputs):
                at, place = outputs * (b - first) + s, stand_in[b, s]
                for c in range(channels):
                    sums[at, c] = conv_empty[place, c]
        for t in range(begin, ends[n]):
            high, wide = sizes[t, 0], sizes[t, 1]
            for y in range(high + 2):
                for j in range(wide + 2):
                    for c in range(channels):
                        scratch[SIDE * y + j, c] = 0.0
                    for i in range(high + 2):
                        e = interpolation[high, y, i]
                        if e != 0.0:
                            place = places[t, SIDE * i + j]
                            for c in range(channels):
                                scratch[SIDE * y + j, c] += e * products[place, c]
                for x in range(wide + 2):
                    target = targets[t, SIDE * y + x]
                    if target >= 0 and _reached(cut[t], live, y, x):
                        at = target - outputs * first
                        for j in range(wide + 2):
                            e = interpolation[wide, x, j]
                            if e != 0.0:
                                for c in range(channels):
                                    sums[at, c] += e * scratch[SIDE * y + j, c]
        for b in range(first, block_ends[n]):
            for c in range(channels):
                out[b, c] = 0.0
                winner[b, c] = NONE
            for s in range(outputs):
                at = outputs * (b - first) + s
                for c in range(channels):
                    higher = sums[at, c] > out[b, c]
                    out[b, c] = sums[at, c] if higher else out[b, c]
                    winner[b, c] = np.uint8(s) if higher else winner[b, c]
            place = stand_in[b, outputs]
            for c in range(channels):
                out[b, c] -= pool_empty[place, c]
        first, begin = block_ends[n], ends[n]


@kernel(error_model="numpy", fastmath={"contract"})
def _spread(
    gradient, winner, cut, live, sizes, places, targets, interpolation, outputs, one, scratch, out
):  # fmt: skip
    """The gradient of ``_pool`` by products: out[place]; one (O,), scratch (SIDE^2, O)."""
    channels = gradient.shape[1]
    for t in range(sizes.shape[0]):
        high, wide = sizes[t, 0], sizes[t, 1]
        for y in range(high + 2):
            for j in range(wide + 2):
                for c in range(channels):
                    scratch[SIDE * y + j, c] = 0.0
            for x in range(wide + 2):
                target = targets[t, SIDE * y + x]
                if target < 0 or not _reached(cut[t], live, y, x):
                    continue
                b, s = target // outputs, np.uint8(target % outputs)
                for c in range(channels):
                    one[c] = gradient[b, c] if winner[b, c] == s else 0.0
                for j in range(wide + 2):
                    e = interpolation[wide, x, j]
                    if e != 0.0:
                        for c in range(channels):
                            scratch[SIDE * y + j, c] += e * one[c]
        for i in range(high + 2):
            for j in range(wide + 2):
                place = places[t, SIDE * i + j]
                e = interpolation[high, 0, i]
                for c in range(channels):
                    out[place, c] = e * scratch[j, c]
                for y in range(1, high + 2):
                    e = interpolation[high, y, i]
                    if e != 0.0:
                        for c in range(channels):
                            out[place, c] += e * scratch[SIDE * y + j, c]


class PatchConvolution(Function):
    """Convolution, ReLU and pooling of rows (R, C) -> (B, O), all as differences.

    weight (POINTS, C, O), see ``weight_at_points``; the others as in ``rows.ConvolvePool``.
    """

    @staticmethod
    def forward(
        ctx: Any,
        rows: Tensor,
        weight: Tensor,
        conv_empty: Tensor,
        pool_empty: Tensor,
        level: Level,
    ) -> Tensor:
        cut = level.patches
        assert cut is not None
        _, inputs, channels = weight.shape
        values = torch.empty(int(cut.starts[-1]), inputs)
        scratch = np.empty((LONGEST * SIDE, inputs), np.float32)
        live = np.empty(len(rows), np.bool_)
        _to_points(
            rows.detach().numpy(), cut.rows, cut.sizes, cut.places, _EVALUATION, scratch,
            values.numpy(), live,
        )  # fmt: skip
        products = torch.empty(len(values), channels)
        for point, part in _points(cut):
            torch.mm(values[part], weight[point], out=products[part])
        blocks = len(level.stand_in)
        out = torch.empty(blocks, channels)
        winner = torch.empty(blocks, channels, dtype=torch.uint8)
        most = int(np.diff(cut.block_ends, prepend=0).max(initial=0))
        outputs = level.stand_in.shape[1] - 1
        _pool(
            products.numpy(), cut.rows, live, cut.sizes, cut.places, cut.targets, cut.ends,
            cut.block_ends, _INTERPOLATION, level.stand_in, conv_empty.detach().numpy(),
            pool_empty.detach().numpy(), np.empty((POINTS, channels), np.float32),
            np.empty((outputs * most, channels), np.float32), out.numpy(), winner.numpy(),
        )  # fmt: skip
        ctx.save_for_backward(values, weight, winner)
        ctx.level, ctx.live = level, live
        ctx.shapes = conv_empty.shape, pool_empty.shape
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        values, weight, winner = ctx.saved_tensors
        level: Level = ctx.level
        cut = level.patches
        assert cut is not None
        by_block, by_winner = gradients[0].contiguous().numpy(), winner.numpy()
        _, inputs, channels = weight.shape
        by_products = torch.empty(len(values), channels)
        one, scratch = np.empty(channels, np.float32), np.empty((POINTS, channels), np.float32)
        _spread(
            by_block, by_winner, cut.rows, ctx.live, cut.sizes, cut.places, cut.targets,
            _INTERPOLATION, level.stand_in.shape[1] - 1, one, scratch, by_products.numpy(),
        )  # fmt: skip
        conv_empty, pool_empty = (torch.zeros(shape) for shape in ctx.shapes)
        spread_empty(by_block, by_winner, level.stand_in, conv_empty.numpy(), pool_empty.numpy())
        by_weight, by_values = torch.zeros_like(weight), torch.empty_like(values)
        for point, part in _points(cut):
            torch.mm(values[part].t(), by_products[part], out=by_weight[point])
            torch.mm(by_products[part], weight[point].t(), out=by_values[part])
        by_rows = torch.empty(len(ctx.live), inputs)
        scratch = np.empty((LONGEST * SIDE, inputs), np.float32)
        _to_rows(
            by_values.numpy(), cut.rows, cut.sizes, cut.places, _EVALUATION, scratch,
            by_rows.numpy(),
        )  # fmt: skip
        return by_rows, by_weight, conv_empty, pool_empty, None


def _points(cut: Patches) -> list[tuple[int, slice]]:
    """Points that any patch has, and where their values stand."""
    pairs = enumerate(pairwise(cut.starts.tolist()))
    return [(point, slice(begin, end)) for point, (begin, end) in pairs if begin < end]


def weight_at_points(weight: Tensor) -> Tensor:
    """A kernel (O, C, 3, 3) as PatchConvolution multiplies it: (POINTS, C, O)."""
    outputs, inputs = weight.shape[:2]
    taps = weight.permute(2, 3, 1, 0).reshape(9, inputs * outputs)
    return (torch.from_numpy(kernel_evaluation()) @ taps).view(POINTS, inputs, outputs)


def convolve_patches(
    rows: Tensor, weight: Tensor, conv_empty: Tensor, pool_empty: Tensor, level: Level
) -> Tensor:
    """Convolution, ReLU and pooling of differences; see PatchConvolution."""
    return PatchConvolution.apply(rows, weight, conv_empty, pool_empty, level)


KERNELS = (_cover, _places, _to_points, _pool)
"""What acting calls from Python."""
