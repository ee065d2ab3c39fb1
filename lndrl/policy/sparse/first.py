"""The first convolution of a map, of three channels: too few for a product to pay.

What a product of so few columns writes and reads again takes longer than its arithmetic, so here
each output sums what lies under its taps. Rows hold differences from the empty map, as everywhere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lndrl.kernels import kernel
from lndrl.policy.sparse.rows import NONE, Rows

if TYPE_CHECKING:
    from lndrl.policy.sparse.structure import Level

Winner = NDArray[np.uint8]


@kernel(error_model="numpy", fastmath={"contract"})
def _convolve(rows, weight, taps, stand_in, conv_empty, pool_empty, sums, out, winner):
    """out[b] = relu(max over outputs s of a block) - pool_empty; winner[b] = the s that won.

    An output is conv_empty plus rows[row] @ weight[k] for each of its taps k; sums is scratch (O,).
    """
    channels = sums.shape[0]
    for b in range(taps.shape[0]):
        for j in range(channels):
            out[b, j] = 0.0
            winner[b, j] = NONE
        for s in range(stand_in.shape[1] - 1):
            place = stand_in[b, s]
            for j in range(channels):
                sums[j] = conv_empty[place, j]
            for k in range(9):
                row = taps[b, 9 * s + k]
                if row >= 0:
                    for c in range(rows.shape[1]):
                        x = rows[row, c]
                        for j in range(channels):
                            sums[j] += weight[k, c, j] * x
            for j in range(channels):
                higher = sums[j] > out[b, j]
                out[b, j] = sums[j] if higher else out[b, j]
                winner[b, j] = np.uint8(s) if higher else winner[b, j]
        place = stand_in[b, stand_in.shape[1] - 1]
        for j in range(channels):
            out[b, j] -= pool_empty[place, j]


@kernel(error_model="numpy", fastmath={"contract"})
def _by_weight(gradient, winner, rows, taps, passed, out):
    """The gradient of ``_convolve`` by weight, added to out (9, C, O); ``passed`` scratch (O,)."""
    channels = passed.shape[0]
    for b in range(taps.shape[0]):
        for s in range(taps.shape[1] // 9):
            for j in range(channels):
                passed[j] = gradient[b, j] if winner[b, j] == s else np.float32(0.0)
            for k in range(9):
                row = taps[b, 9 * s + k]
                if row >= 0:
                    for c in range(rows.shape[1]):
                        x = rows[row, c]
                        for j in range(channels):
                            out[k, c, j] += passed[j] * x


def convolve_first(
    rows: Rows, weight: Rows, conv_empty: Rows, pool_empty: Rows, level: Level
) -> tuple[Rows, Winner]:
    """Convolution, ReLU and pooling of rows (R, C): differences (B, O), and which output won.

    weight (9, C, O), see ``tap_weight``; the others as in ``rows.sum_and_pool``.
    """
    blocks, channels = len(level.taps), weight.shape[2]
    out, winner = np.empty((blocks, channels), np.float32), np.empty((blocks, channels), np.uint8)
    sums = np.empty(channels, np.float32)
    _convolve(
        rows, weight, level.taps, level.stand_in, conv_empty, pool_empty, sums, out, winner
    )  # fmt: skip
    return out, winner


def gradient_by_weight(gradient: Rows, winner: Winner, rows: Rows, level: Level) -> Rows:
    """The gradient (9, C, O) of ``convolve_first`` by weight, from that by its result."""
    channels = gradient.shape[1]
    out = np.zeros((9, rows.shape[1], channels), np.float32)
    _by_weight(gradient, winner, rows, level.taps, np.empty(channels, np.float32), out)
    return out


def tap_weight(weight: NDArray[np.float32]) -> Rows:
    """A kernel (O, C, 3, 3) as ``convolve_first`` takes it: (9, C, O), tap by tap."""
    outputs, inputs = weight.shape[:2]
    return np.ascontiguousarray(weight.transpose(2, 3, 1, 0).reshape(9, inputs, outputs))


KERNELS = (_convolve,)
"""What acting calls from Python."""
