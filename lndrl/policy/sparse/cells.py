"""The linear layer over the cells of the last map, cell by cell, with gradients.

Only rows that differ from the response to the empty map are multiplied, those of a cell together.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function

from lndrl.kernels import kernel
from lndrl.policy.sparse.products import gradient_part, times_part
from lndrl.policy.sparse.rows import product
from lndrl.policy.sparse.structure import MapStructure


@kernel()
def _add_rows(rows, index, out):
    """out[index[i]] += rows[i]."""
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            out[index[i], j] += rows[i, j]


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
            part = slice(begin, end)
            times_part(by_row, part, weight[cell], by_grouped)
            gradient_part(by_row, grouped, part, by_weight[cell])
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
                times_part(grouped, rows, weight[cell].t(), products)
            else:
                products[rows] = product(grouped[rows], weight[cell].t())
    out = torch.zeros(s.samples + 1, weight.shape[1])
    _add_rows(products.numpy(), s.sample, out.numpy())
    return out


def _groups(s: MapStructure) -> list[tuple[int, int]]:
    return list(pairwise(s.starts.tolist()))


def train_cell_linear(
    rows: Tensor, empty: Tensor, weight: Tensor, bias: Tensor, s: MapStructure
) -> Tensor:
    """The last linear layer with gradients; see CellProduct."""
    return CellProduct.apply(rows, empty, weight, bias, s)


KERNELS = (_add_rows,)
"""What acting calls from Python."""
