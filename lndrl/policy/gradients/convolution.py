"""Convolutions of differences from the empty map: of patches at points, and row by row."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function

from lndrl.policy.sparse import convolution, first, rows
from lndrl.policy.sparse.points import POINTS, kernel_evaluation
from lndrl.policy.sparse.structure import Level


def product(values: Tensor, weight: Tensor) -> Tensor:
    """``values @ weight`` in the type of the weights, as float32: the kernels know no other."""
    return (values.to(weight.dtype) @ weight).float()


class _PatchConvolution(Function):
    """``sparse.convolution.convolve_patches``; all but the level are tensors."""

    @staticmethod
    def forward(
        ctx: Any,
        values: Tensor,
        weight: Tensor,
        conv_empty: Tensor,
        pool_empty: Tensor,
        level: Level,
    ) -> Tensor:
        v, w, conv, pool = (t.detach().numpy() for t in (values, weight, conv_empty, pool_empty))
        done = convolution.convolve_patches(v, w, conv, pool, level)
        ctx.save_for_backward(values, weight)
        ctx.winner, ctx.live = done.winner, done.live
        ctx.level, ctx.places = level, (len(conv_empty), len(pool_empty))
        return torch.from_numpy(done.out)

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        gradient = gradients[0].contiguous().numpy()
        values, weight = (each.numpy() for each in ctx.saved_tensors)
        winner, level = ctx.winner, ctx.level
        by_parts = convolution.gradients(gradient, values, winner, ctx.live, weight, level)
        by_empty = rows.spread_empty(gradient, winner, level, ctx.places)
        return *(torch.from_numpy(each) for each in (*by_parts, *by_empty)), None


class _FirstConvolution(Function):
    """``sparse.first.convolve_first``, of rows (R, C) that are given and need no gradient."""

    @staticmethod
    def forward(
        ctx: Any,
        values: Tensor,
        weight: Tensor,
        conv_empty: Tensor,
        pool_empty: Tensor,
        level: Level,
    ) -> Tensor:
        v, w, conv, pool = (t.detach().numpy() for t in (values, weight, conv_empty, pool_empty))
        out, ctx.winner = first.convolve_first(v, w, conv, pool, level)
        ctx.save_for_backward(values)
        ctx.level, ctx.places = level, (len(conv_empty), len(pool_empty))
        return torch.from_numpy(out)

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        gradient = gradients[0].contiguous().numpy()
        (values,) = ctx.saved_tensors
        by_weight = first.gradient_by_weight(gradient, ctx.winner, values.numpy(), ctx.level)
        by_empty = rows.spread_empty(gradient, ctx.winner, ctx.level, ctx.places)
        return None, *(torch.from_numpy(each) for each in (by_weight, *by_empty)), None


def convolve_patches(
    values: Tensor, weight: Tensor, conv_empty: Tensor, pool_empty: Tensor, level: Level
) -> Tensor:
    """Convolution, ReLU and pooling of differences (R, C) -> (B, O).

    weight as ``weight_at_points`` has it, the empty responses as in ``sparse.rows.sum_and_pool``.
    """
    found: Tensor = _PatchConvolution.apply(values, weight, conv_empty, pool_empty, level)
    return found


def convolve_first(
    values: Tensor, weight: Tensor, conv_empty: Tensor, pool_empty: Tensor, level: Level
) -> Tensor:
    """The same of a map itself, by ``sparse.first``; weight as ``tap_weight`` has it."""
    found: Tensor = _FirstConvolution.apply(values, weight, conv_empty, pool_empty, level)
    return found


def convolve_pool(
    values: Tensor, weight: Tensor, conv_empty: Tensor, pool_empty: Tensor, level: Level
) -> Tensor:
    """The same row by row, without gradients; weight as ``flat_weight`` has it, in any type."""
    products = product(values.detach(), weight.detach()).numpy()
    conv, pool = conv_empty.detach().numpy(), pool_empty.detach().numpy()
    return torch.from_numpy(rows.sum_and_pool(products, conv, pool, level))


def flat_weight(weight: Tensor) -> Tensor:
    """A kernel (O, C, 3, 3) as ``convolve_pool`` multiplies it: (C, 9 * O), tap by tap."""
    outputs, inputs = weight.shape[:2]
    return weight.permute(1, 2, 3, 0).reshape(inputs, 9 * outputs)


def tap_weight(weight: Tensor) -> Tensor:
    """See ``sparse.first.tap_weight``."""
    outputs, inputs = weight.shape[:2]
    return weight.permute(2, 3, 1, 0).reshape(9, inputs, outputs).float().contiguous()


def weight_at_points(weight: Tensor) -> Tensor:
    """See ``sparse.convolution.weight_at_points``."""
    outputs, inputs = weight.shape[:2]
    taps = weight.permute(2, 3, 1, 0).reshape(9, inputs * outputs)
    return (torch.from_numpy(kernel_evaluation()) @ taps).view(POINTS, inputs, outputs)
