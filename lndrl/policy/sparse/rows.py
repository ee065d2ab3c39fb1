"""Convolutions evaluated row by row, for products in bfloat16.

Rows hold *differences* from the response to the empty map, so whatever lies beside them counts as
zero. Each input row is multiplied once with all nine taps of the kernel, in one dense matrix
product, and a compiled kernel sums the products under each output, adds the response to the empty
map and pools.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lndrl.kernels import kernel

if TYPE_CHECKING:
    from lndrl.policy.sparse.structure import Level

NONE = 255  # of the pooled outputs none was above zero

Rows = NDArray[np.float32]


@kernel()
def _sum_and_pool(products, taps, stand_in, conv_empty, pool_empty, sums, out):
    """out[b] = relu(max over outputs s of a block) - pool_empty.

    An output is conv_empty plus products[row, k] for each of its taps k; ``products`` is
    (R, 9 * O), ``sums`` scratch (P, O).
    """
    outputs, channels = sums.shape
    for b in range(taps.shape[0]):
        for s in range(outputs):
            place = stand_in[b, s]
            for j in range(channels):
                sums[s, j] = conv_empty[place, j]
            for k in range(9):
                row = taps[b, 9 * s + k]
                if row >= 0:
                    start = k * channels
                    for j in range(channels):
                        sums[s, j] += products[row, start + j]
        for j in range(channels):
            out[b, j] = 0.0
        for s in range(outputs):
            for j in range(channels):
                out[b, j] = max(out[b, j], sums[s, j])
        place = stand_in[b, outputs]
        for j in range(channels):
            out[b, j] -= pool_empty[place, j]


@kernel()
def _spread_empty(gradient, winner, stand_in, conv_out, pool_out):
    """The gradients by conv_empty and pool_empty of what came of pooled outputs, see ``winner``."""
    outputs = stand_in.shape[1] - 1
    for b in range(gradient.shape[0]):
        place = stand_in[b, outputs]
        for j in range(gradient.shape[1]):
            pool_out[place, j] -= gradient[b, j]
        for s in range(outputs):
            place = stand_in[b, s]
            for j in range(gradient.shape[1]):
                if winner[b, j] == s:
                    conv_out[place, j] += gradient[b, j]


def sum_and_pool(products: Rows, conv_empty: Rows, pool_empty: Rows, level: Level) -> Rows:
    """What products of rows (R, 9 * O) are after sums, ReLU and pooling, as differences (B, O).

    conv_empty and pool_empty are the response to the empty map, before and after ReLU and pooling,
    as rows of the stand-in.
    """
    channels = products.shape[1] // 9
    out = np.empty((len(level.taps), channels), np.float32)
    sums = np.empty((level.stand_in.shape[1] - 1, channels), np.float32)
    _sum_and_pool(products, level.taps, level.stand_in, conv_empty, pool_empty, sums, out)
    return out


def spread_empty(
    gradient: Rows, winner: NDArray[np.uint8], level: Level, places: tuple[int, int]
) -> tuple[Rows, Rows]:
    """The gradients by conv_empty and pool_empty, which have so many rows.

    ``gradient`` (B, O) is that by the pooled differences, ``winner`` which output of each block was
    the largest.
    """
    conv, pool = (np.zeros((n, gradient.shape[1]), np.float32) for n in places)
    _spread_empty(gradient, winner, level.stand_in, conv, pool)
    return conv, pool


KERNELS = (_sum_and_pool,)
"""What acting in bfloat16 calls from Python."""
