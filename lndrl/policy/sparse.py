"""Differentiable evaluation of the rows that ``structure`` lists.

Rows hold *differences* from the response to the empty map, so whatever lies beside them counts as
zero. A convolution multiplies each of its input rows once with all nine taps of the kernel, in one
dense matrix product, and a compiled kernel sums the products under each output, adds the
response to the empty map and pools. The last linear layer multiplies cell by cell. torch does the
products and keeps the gradients.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd import Function

from lndrl.kernels import kernel
from lndrl.policy.structure import Level, MapStructure

_NONE = 255  # of the pooled outputs none was above zero


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
            winner[b, j] = _NONE
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
def _spread_empty(gradient, winner, stand_in, conv_out, pool_out):
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


@kernel()
def _add_rows(rows, index, out):
    """out[index[i]] += rows[i]."""
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            out[index[i], j] += rows[i, j]


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
        _spread_empty(
            by_block, by_winner, ctx.level.stand_in, conv_empty.numpy(), pool_empty.numpy()
        )
        by_rows = spread @ weight.t() if ctx.needs_input_grad[0] else None
        return by_rows, rows.t() @ spread, conv_empty, pool_empty, None


def flat_weight(weight: Tensor) -> Tensor:
    """A kernel (O, C, 3, 3) as ConvolvePool multiplies it: (C, 9 * O), tap by tap."""
    outputs, inputs = weight.shape[:2]
    return weight.permute(1, 2, 3, 0).reshape(inputs, 9 * outputs)


class CellProduct(Function):
    """The linear layer over the cells of the last map: rows (B, C) -> (N, F).

    weight (cells, F, C), bias (F,); ``empty`` (cells, C) is the whole last map of an empty map,
    to which the rows are differences.
    """

    @staticmethod
    def forward(
        ctx: Any, rows: Tensor, empty: Tensor, weight: Tensor, bias: Tensor, s: MapStructure
    ) -> Tensor:
        grouped = torch.cat((rows, empty))[torch.from_numpy(s.order)]
        ctx.save_for_backward(grouped, weight)
        ctx.structure = s
        out = _multiply_cells(grouped, weight, s, 0)
        return out[:-1] + (out[-1] + bias)

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        (gradient,) = gradients
        grouped, weight = ctx.saved_tensors
        s: MapStructure = ctx.structure
        total = gradient.sum(0)
        by_row = torch.cat((gradient, total[None]))[torch.from_numpy(s.sample)]
        by_weight = torch.empty_like(weight)
        by_grouped = torch.empty_like(grouped)
        for cell, (begin, end) in enumerate(_groups(s)):
            part = by_row[begin:end]
            torch.mm(part, weight[cell], out=by_grouped[begin:end])
            torch.mm(part.t(), grouped[begin:end], out=by_weight[cell])
        by_rows = torch.empty_like(by_grouped)
        by_rows[torch.from_numpy(s.order)] = by_grouped
        blocks = len(grouped) - len(s.cell_stand_in)
        return by_rows[:blocks], by_rows[blocks:], by_weight, total, None


def cell_linear(rows: Tensor, weight: Tensor, base: Tensor, s: MapStructure) -> Tensor:
    """CellProduct without gradients: ``base`` (F,) is the layer's response to the empty map."""
    absent = rows.new_zeros(len(s.cell_stand_in), rows.shape[1])
    grouped = torch.cat((rows, absent))[torch.from_numpy(s.order)]
    return _multiply_cells(grouped, weight, s, 1)[:-1] + base


def _multiply_cells(grouped: Tensor, weight: Tensor, s: MapStructure, skip: int) -> Tensor:
    """Sums by sample (N + 1, F) of rows in the order of ``s.order``, times their cell's weights.

    The last row sums the empty responses. The first ``skip`` rows of each cell are left out.
    """
    products = torch.zeros(len(grouped), weight.shape[1])
    for cell, (begin, end) in enumerate(_groups(s)):
        if begin + skip < end:
            rows = slice(begin + skip, end)
            if weight.dtype == torch.float32:
                torch.mm(grouped[rows], weight[cell].t(), out=products[rows])
            else:
                products[rows] = product(grouped[rows], weight[cell].t())
    out = torch.zeros(s.samples + 1, weight.shape[1])
    _add_rows(products.numpy(), s.sample, out.numpy())
    return out


def _groups(s: MapStructure) -> list[tuple[int, int]]:
    return list(pairwise(s.starts.tolist()))


def convolve_pool(
    rows: Tensor, weight: Tensor, conv_empty: Tensor, pool_empty: Tensor, level: Level
) -> Tensor:
    """Convolution, ReLU and pooling of differences; see ConvolvePool."""
    return ConvolvePool.apply(rows, weight, conv_empty, pool_empty, level)


def train_cell_linear(
    rows: Tensor, empty: Tensor, weight: Tensor, bias: Tensor, s: MapStructure
) -> Tensor:
    """The last linear layer with gradients; see CellProduct."""
    return CellProduct.apply(rows, empty, weight, bias, s)


KERNELS = (_sum_and_pool, _add_rows)
"""What acting calls from Python."""
