"""Convolutions of patches at points (see ``points``), and their gradients.

A compiled kernel takes the patches to the points, one matrix product per point multiplies all
patches of a group of samples that have it, another kernel takes the products back, adds the
response to the empty map and pools. Rows hold differences from that response, so that all around
is zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lndrl.kernels import kernel
from lndrl.policy.sparse.points import (
    LONGEST,
    POINTS,
    SIDE,
    evaluation,
    interpolation,
    kernel_evaluation,
)
from lndrl.policy.sparse.rows import NONE, Rows

if TYPE_CHECKING:
    from lndrl.policy.sparse.structure import Level

_EVALUATION, _INTERPOLATION = evaluation(), interpolation()


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


@kernel()
def _find_live(rows, live):
    """live[row] = whether a row is anything but zero."""
    for row in range(rows.shape[0]):
        live[row] = False
        for c in range(rows.shape[1]):
            if rows[row, c] != 0.0:
                live[row] = True
                break


@kernel(error_model="numpy", fastmath={"contract"})
def _to_points(rows, cut, sizes, places, evaluation, scratch, out):
    """out[place] = the values of a patch at a point; scratch (LONGEST * SIDE, C)."""
    channels = rows.shape[1]
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
def _combine(values, rows, weights, number, out, at, add):
    """out[at] = the sum of ``number`` rows of ``values``, at most six, each with its weight; or +=
    with ``add``.

    Three at a time: every sum that goes through memory costs as much as the arithmetic.
    """
    for k in range(number, SIDE):  # what is there already must be multiplied with zero, too
        rows[k], weights[k] = rows[0], 0.0
    a, b, c = rows[0], rows[1], rows[2]
    u, v, w = weights[0], weights[1], weights[2]
    if add:
        for k in range(out.shape[1]):
            out[at, k] += u * values[a, k] + v * values[b, k] + w * values[c, k]
    else:
        for k in range(out.shape[1]):
            out[at, k] = u * values[a, k] + v * values[b, k] + w * values[c, k]
    a, b, c = rows[3], rows[4], rows[5]
    u, v, w = weights[3], weights[4], weights[5]
    if u != 0.0 or v != 0.0 or w != 0.0:
        for k in range(out.shape[1]):
            out[at, k] += u * values[a, k] + v * values[b, k] + w * values[c, k]


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
    chosen, weights = np.zeros(SIDE, np.int64), np.zeros(SIDE, np.float32)
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
                for i in range(high + 2):
                    weights[i] = interpolation[high, y, i]
                for j in range(wide + 2):
                    for i in range(high + 2):
                        chosen[i] = places[t, SIDE * i + j]
                    _combine(products, chosen, weights, high + 2, scratch, SIDE * y + j, False)
            for x in range(wide + 2):
                for j in range(wide + 2):
                    weights[j] = interpolation[wide, x, j]
                for y in range(high + 2):
                    target = targets[t, SIDE * y + x]
                    if target >= 0 and _reached(cut[t], live, y, x):
                        for j in range(wide + 2):
                            chosen[j] = SIDE * y + j
                        _combine(
                            scratch, chosen, weights, wide + 2, sums, target - outputs * first, True
                        )
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
    gradient, winner, cut, live, sizes, places, targets, interpolation, outputs, plane, scratch, out
):  # fmt: skip
    """The gradient of ``_pool`` by products: out[place]; plane and scratch (SIDE^2, O)."""
    channels = gradient.shape[1]
    chosen, weights = np.zeros(SIDE, np.int64), np.zeros(SIDE, np.float32)
    for t in range(sizes.shape[0]):
        high, wide = sizes[t, 0], sizes[t, 1]
        for y in range(high + 2):
            for x in range(wide + 2):
                at, target = SIDE * y + x, targets[t, SIDE * y + x]
                if target < 0 or not _reached(cut[t], live, y, x):
                    for c in range(channels):
                        plane[at, c] = 0.0
                    continue
                b, s = target // outputs, np.uint8(target % outputs)
                for c in range(channels):
                    plane[at, c] = gradient[b, c] if winner[b, c] == s else np.float32(0.0)
        for j in range(wide + 2):
            for x in range(wide + 2):
                weights[x] = interpolation[wide, x, j]
            for y in range(high + 2):
                for x in range(wide + 2):
                    chosen[x] = SIDE * y + x
                _combine(plane, chosen, weights, wide + 2, scratch, SIDE * y + j, False)
        for i in range(high + 2):
            for y in range(high + 2):
                weights[y] = interpolation[high, y, i]
            for j in range(wide + 2):
                for y in range(high + 2):
                    chosen[y] = SIDE * y + j
                _combine(scratch, chosen, weights, high + 2, out, places[t, SIDE * i + j], False)


@dataclass(frozen=True)
class Convolved:
    """A convolution's result, and what its gradients need.

    out float32 (B, O), the largest outputs of blocks after ReLU, as differences; winner uint8
    (B, O), which output of the block that was; live bool (R,), which rows are anything but zero.
    """

    out: Rows
    winner: NDArray[np.uint8]
    live: NDArray[np.bool_]


def convolve_patches(
    rows: Rows, weight: Rows, conv_empty: Rows, pool_empty: Rows, level: Level
) -> Convolved:
    """Convolution, ReLU and pooling of rows (R, C), all as differences.

    weight (POINTS, C, O), see ``weight_at_points``; the others as in ``rows.sum_and_pool``.
    """
    cut = level.patches
    assert cut is not None
    _, inputs, channels = weight.shape
    blocks, outputs = len(level.stand_in), level.stand_in.shape[1] - 1
    out, winner = np.empty((blocks, channels), np.float32), np.empty((blocks, channels), np.uint8)
    live = np.empty(len(rows), np.bool_)
    _find_live(rows, live)
    most = int(np.diff(cut.block_ends, prepend=0).max(initial=0))
    values, products = (np.empty((cut.most, each), np.float32) for each in (inputs, channels))
    scratch = np.empty((LONGEST * SIDE, inputs), np.float32)
    plane = np.empty((POINTS, channels), np.float32)
    sums = np.empty((outputs * most, channels), np.float32)
    for group in cut.groups(outputs):
        _to_points(rows, group.rows, group.sizes, group.places, _EVALUATION, scratch, values)
        for point, begin, end in group.points():
            np.dot(values[begin:end], weight[point], out=products[begin:end])
        its = group.blocks
        _pool(
            products, group.rows, live, group.sizes, group.places, group.targets, group.ends,
            group.block_ends, _INTERPOLATION, level.stand_in[its], conv_empty, pool_empty, plane,
            sums, out[its], winner[its],
        )  # fmt: skip
    return Convolved(out, winner, live)


def gradients(
    gradient: Rows,
    rows: Rows,
    winner: NDArray[np.uint8],
    live: NDArray[np.bool_],
    weight: Rows,
    level: Level,
) -> tuple[Rows, Rows]:
    """The gradients of ``convolve_patches`` by its rows and weight, from that by its ``out``.

    ``winner`` and ``live`` as of Convolved.
    """
    cut = level.patches
    assert cut is not None
    _, inputs, channels = weight.shape
    by_weight, by_rows = np.zeros_like(weight), np.empty((len(rows), inputs), np.float32)
    values, by_products = (np.empty((cut.most, each), np.float32) for each in (inputs, channels))
    scratch = np.empty((LONGEST * SIDE, inputs), np.float32)
    plane, across = np.empty((2, POINTS, channels), np.float32)
    outputs = level.stand_in.shape[1] - 1
    for number, group in enumerate(cut.groups(outputs)):
        its, where = group.blocks, (group.rows, group.sizes, group.places)
        # Found again: what a cache holds costs less than what was written to memory meanwhile.
        _to_points(rows, *where, _EVALUATION, scratch, values)
        _spread(
            gradient[its], winner[its], group.rows, live, group.sizes, group.places, group.targets,
            _INTERPOLATION, outputs, plane, across, by_products,
        )  # fmt: skip
        for point, begin, end in group.points():
            part, there = by_products[begin:end], values[begin:end]
            if number:
                by_weight[point] += np.dot(there.T, part)
            else:
                np.dot(there.T, part, out=by_weight[point])
            np.dot(part, weight[point].T, out=there)  # by the values, in their place
        _to_rows(values, *where, _EVALUATION, scratch, by_rows)
    return by_rows, by_weight


def weight_at_points(weight: NDArray[np.float32]) -> Rows:
    """A kernel (O, C, 3, 3) as patches are multiplied with it: (POINTS, C, O)."""
    outputs, inputs = weight.shape[:2]
    taps = weight.transpose(2, 3, 1, 0).reshape(9, inputs * outputs)
    return (kernel_evaluation() @ taps).reshape(POINTS, inputs, outputs)


KERNELS = (_find_live, _to_points, _pool)
"""What acting calls from Python."""
