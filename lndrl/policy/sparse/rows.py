"""Convolutions evaluated row by row, with gradients; for few channels, and in bfloat16.

Rows hold *differences* from the response to the empty map, so whatever lies beside them counts as
zero. Each input row is multiplied once with all nine taps of the kernel, in one dense matrix
product, and a compiled kernel sums the products under each output, adds the response to the empty
map and pools. torch does the products and keeps the gradients.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd import Function

from lndrl.kernels import kernel

if TYPE_CHECKING:
    from lndrl.policy.sparse.structure import Level

NONE = 255  # of the pooled outputs none was above zero


@kernel()
def _sum_and_pool(products, taps, stand_in, conv_empty, pool_empty, sums, out, winner):
    """out[b] = relu(max over outputs s of a block) - pool_empty; winner[b] = the s that won.

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
            winner[b, j] = NONE
        for s in range(outputs):
            for j in range(channels):
                higher = sums[s, j] > out[b, j]
                out[b, j] = sums[s, j] if higher else out[b, j]
                winner[b, j] = np.uint8(s) if higher else winner[b, j]
        place = stand_in[b, outputs]
        for j in range(channels):
            out[b, j] -= pool_empty[place, j]


@kernel()
def _spread(gradient, winner, targets, outputs, out):
    """The gradient of ``_sum_and_pool`` by products: out (R, 9 * O)."""
    channels = gradient.shape[1]
    zero = np.float32(0.0)
    for row in range(targets.shape[0]):
        for k in range(9):
            start = k * channels
            target = targets[row, k]
            if target < 0:
                for j in range(channels):
                    out[row, start + j] = zero
            else:
                b, s = target // outputs, np.uint8(target % outputs)
                for j in range(channels):
                    out[row, start + j] = gradient[b, j] if winner[b, j] == s else zero


@kernel()
def spread_empty(gradient, winner, stand_in, conv_out, pool_out):
    """The gradient of ``_sum_and_pool`` by conv_empty and pool_empty."""
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


def product(rows: Tensor, weight: Tensor) -> Tensor:
    """``rows @ weight`` in the type of the weights, as float32: the kernels know no other."""
    return (rows.to(weight.dtype) @ weight).float()


class ConvolvePool(Function):
    """Convolution, ReLU and pooling of rows (R, C) -> (B, O), all as differences.

    weight (C, 9 * O), see ``flat_weight``. conv_empty and pool_empty are the response to the
    empty map, before and after ReLU and pooling, as rows of the stand-in.
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
        channels = weight.shape[1] // 9
        products = product(rows, weight)
        out = torch.empty(len(level.taps), channels)
        winner = torch.empty(len(level.taps), channels, dtype=torch.uint8)
        _sum_and_pool(
            products.numpy(),
            level.taps,
            level.stand_in,
            conv_empty.detach().numpy(),
            pool_empty.detach().numpy(),
            np.empty((level.stand_in.shape[1] - 1, channels), np.float32),
            out.numpy(),
            winner.numpy(),
        )
        ctx.save_for_backward(rows, weight, winner)
        ctx.level = level
        ctx.shapes = conv_empty.shape, pool_empty.shape
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        (gradient,) = gradients
        rows, weight, winner = ctx.saved_tensors
        by_block, by_winner = gradient.contiguous().numpy(), winner.numpy()
        spread = torch.empty(len(rows), weight.shape[1])
        outputs = ctx.level.stand_in.shape[1] - 1
        _spread(by_block, by_winner, ctx.level.targets, outputs, spread.numpy())
        conv_empty, pool_empty = (torch.zeros(shape) for shape in ctx.shapes)
        spread_empty(
            by_block, by_winner, ctx.level.stand_in, conv_empty.numpy(), pool_empty.numpy()
        )
        by_rows = spread @ weight.t() if ctx.needs_input_grad[0] else None
        return by_rows, rows.t() @ spread, conv_empty, pool_empty, None


def flat_weight(weight: Tensor) -> Tensor:
    """A kernel (O, C, 3, 3) as ConvolvePool multiplies it: (C, 9 * O), tap by tap."""
    outputs, inputs = weight.shape[:2]
    return weight.permute(1, 2, 3, 0).reshape(inputs, 9 * outputs)


def convolve_pool(
    rows: Tensor, weight: Tensor, conv_empty: Tensor, pool_empty: Tensor, level: Level
) -> Tensor:
    """Convolution, ReLU and pooling of differences; see ConvolvePool."""
    return ConvolvePool.apply(rows, weight, conv_empty, pool_empty, level)


KERNELS = (_sum_and_pool,)
"""What acting calls from Python."""
