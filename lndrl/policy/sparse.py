"""Differentiable gather-convolutions over the rows that ``structure`` lists.

Each convolution gathers the 3x3 windows of the listed outputs into a matrix and multiplies it
with the weights, so all arithmetic is one dense matrix product per layer. Compiled kernels move
the rows; torch multiplies and keeps the gradients.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd import Function


@njit(cache=True, nogil=True)
def _gather(table, index, out):
    """out[m, k*C:(k+1)*C] = table[index[m, k]], zeros where the index is -1."""
    channels = table.shape[1]
    for m in range(index.shape[0]):
        for k in range(index.shape[1]):
            row = index[m, k]
            start = k * channels
            if row < 0:
                for c in range(channels):
                    out[m, start + c] = 0.0
            else:
                for c in range(channels):
                    out[m, start + c] = table[row, c]


@njit(cache=True, nogil=True)
def _scatter(rows, index, table):
    """The transpose of ``_gather``: table[index[m, k]] += rows[m, k*C:(k+1)*C]."""
    channels = table.shape[1]
    table[:] = 0.0
    for m in range(index.shape[0]):
        for k in range(index.shape[1]):
            row = index[m, k]
            if row >= 0:
                start = k * channels
                for c in range(channels):
                    table[row, c] += rows[m, start + c]


@njit(cache=True, nogil=True)
def _pool(values, index, out):
    """out[m] = relu(max over the 4 rows values[index[m]])."""
    for m in range(index.shape[0]):
        a, b, c, d = index[m, 0], index[m, 1], index[m, 2], index[m, 3]
        for j in range(values.shape[1]):
            left = max(values[a, j], values[b, j])
            right = max(values[c, j], values[d, j])
            out[m, j] = max(max(left, right), np.float32(0.0))


@njit(cache=True, nogil=True)
def _unpool(gradient, values, pooled, index, out):
    """The gradient of ``_pool``; of equal values the first takes it, as torch does."""
    out[:] = 0.0
    for m in range(index.shape[0]):
        a, b, c, d = index[m, 0], index[m, 1], index[m, 2], index[m, 3]
        for j in range(values.shape[1]):
            best = pooled[m, j]
            if best > 0.0:
                g = gradient[m, j]
                if values[a, j] == best:
                    out[a, j] += g
                elif values[b, j] == best:
                    out[b, j] += g
                elif values[c, j] == best:
                    out[c, j] += g
                else:
                    out[d, j] += g


class GatherConvolution(Function):
    """``gather(table, index) @ weight.T + bias`` with its gradients.

    table (R, C), index int32 (M, K) with -1 for zeros, weight (O, K * C), bias (O) -> (M, O).
    """

    @staticmethod
    def forward(
        ctx: Any, table: Tensor, index: NDArray[np.int32], weight: Tensor, bias: Tensor
    ) -> Tensor:
        windows = torch.empty(index.shape[0], index.shape[1] * table.shape[1])
        _gather(table.detach().numpy(), index, windows.numpy())
        ctx.save_for_backward(windows, weight)
        ctx.index, ctx.rows = index, table.shape[0]
        return torch.addmm(bias, windows, weight.t())

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        (gradient,) = gradients
        windows, weight = ctx.saved_tensors
        rows = gradient @ weight
        table = torch.empty(ctx.rows, weight.shape[1] // ctx.index.shape[1])
        _scatter(rows.numpy(), ctx.index, table.numpy())
        return table, None, gradient.t() @ windows, gradient.sum(0)


class GatherPool(Function):
    """``relu(max(values[index]))`` over the four rows of each index: values (R, C) -> (M, C)."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, index: NDArray[np.int32]) -> Tensor:
        pooled = torch.empty(index.shape[0], values.shape[1])
        _pool(values.detach().numpy(), index, pooled.numpy())
        ctx.save_for_backward(values, pooled)
        ctx.index = index
        return pooled

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        (gradient,) = gradients
        values, pooled = ctx.saved_tensors
        out = torch.empty_like(values)
        _unpool(
            gradient.contiguous().numpy(), values.numpy(), pooled.numpy(), ctx.index, out.numpy()
        )
        return out, None


def gather_convolution(
    table: Tensor, index: NDArray[np.int32], weight: Tensor, bias: Tensor
) -> Tensor:
    """Convolution at the listed outputs; see GatherConvolution."""
    return GatherConvolution.apply(table, index, weight, bias)


class GatherRows(Function):
    """``gather(table, index)``: table (R, C), index int32 (N, K) -> (N, K * C)."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, index: NDArray[np.int32]) -> Tensor:
        out = torch.empty(index.shape[0], index.shape[1] * table.shape[1])
        _gather(table.detach().numpy(), index, out.numpy())
        ctx.index, ctx.shape = index, table.shape
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        (gradient,) = gradients
        table = torch.empty(ctx.shape)
        _scatter(gradient.contiguous().numpy(), ctx.index, table.numpy())
        return table, None


def gather_rows(table: Tensor, index: NDArray[np.int32]) -> Tensor:
    """Rows of ``table`` side by side; see GatherRows."""
    return GatherRows.apply(table, index)


def gather_pool(values: Tensor, index: NDArray[np.int32]) -> Tensor:
    """Max-pooling and ReLU at the listed outputs; see GatherPool."""
    return GatherPool.apply(values, index)
