"""The linear layer over the cells of the last map; weight (cells, F, C), bias (F,)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function

from lndrl.policy.gradients.convolution import product
from lndrl.policy.sparse import cells
from lndrl.policy.sparse.structure import MapStructure


class _CellProduct(Function):
    """rows (B, C), and ``empty`` (cells, C) to which they are differences -> (N, F)."""

    @staticmethod
    def forward(
        ctx: Any, rows: Tensor, empty: Tensor, weight: Tensor, bias: Tensor, s: MapStructure
    ) -> Tensor:
        ctx.save_for_backward(rows, empty, weight)
        ctx.structure = s
        r, e, w = (each.detach().numpy() for each in (rows, empty, weight))
        out = torch.from_numpy(cells.multiply_cells(r, e, w.transpose(0, 2, 1), s))
        return out[:-1] + (out[-1] + bias)

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        rows, empty, weight = (each.numpy() for each in ctx.saved_tensors)
        total = gradients[0].sum(0)
        whole = torch.cat((gradients[0], total[None])).numpy()
        found = cells.gradients(whole, rows, empty, weight, ctx.structure)
        by_rows, by_empty, by_weight = (torch.from_numpy(each) for each in found)
        return by_rows, by_empty, by_weight, total, None


def train_cell_linear(
    rows: Tensor, empty: Tensor, weight: Tensor, bias: Tensor, s: MapStructure
) -> Tensor:
    """The layer with gradients; ``empty`` (cells, C) is the last map of an empty map."""
    found: Tensor = _CellProduct.apply(rows, empty, weight, bias, s)
    return found


def cell_linear(rows: Tensor, weight: Tensor, base: Tensor, s: MapStructure) -> Tensor:
    """The layer without gradients: ``base`` (F,) is its response to the empty map."""
    if weight.dtype == torch.float32:
        by_cell = weight.detach().numpy().transpose(0, 2, 1)
        return torch.from_numpy(cells.cell_linear(rows.numpy(), by_cell, base.numpy(), s))
    absent = rows.new_zeros(len(s.cell_stand_in), rows.shape[1])
    in_order = torch.cat((rows, absent))[torch.from_numpy(s.order)]
    products = torch.zeros(len(in_order), weight.shape[1])
    for cell, (begin, end) in enumerate(cells.groups(s)):
        products[begin:end] = product(in_order[begin:end], weight[cell].t())
    return torch.from_numpy(cells.sums_by_sample(products.numpy(), s)[:-1]) + base
