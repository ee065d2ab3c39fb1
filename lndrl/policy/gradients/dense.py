"""Dense layers in float32 on the CPU, by whichever of torch's two libraries is faster there.

torch multiplies matrices by MKL, which on processors of AMD does without AVX-512: oneDNN, which
torch brings for its compiled models, is twice as fast there with AVX-512 and 15 % faster with AVX2.
The choice depends on the processor and on sizes alone, so a run has the same bits every time.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import torch
from torch import Tensor, nn
from torch.autograd import Function

from lndrl.machine.processor import vendor

_LEAST = 2**20
"""Multiplications of a product below which oneDNN takes longer to begin than it saves."""


def linear(layer: nn.Linear, x: Tensor) -> Tensor:
    """``layer(x)`` of samples (N, inputs), with gradients."""
    plain = x.ndim != 2 or x.dtype != torch.float32 or layer.weight.dtype != torch.float32
    # In a graph that is exported, an operation of torch's own would be unknown elsewhere.
    if plain or torch.compiler.is_exporting() or torch.is_autocast_enabled(x.device.type):
        return layer(x)
    if not _is_faster(x, layer.out_features):
        return layer(x)
    return _Linear.apply(x, layer.weight, layer.bias)


class _Linear(Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        ctx.save_for_backward(x, weight)
        return _by_onednn(x, weight, bias)

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        x, weight = ctx.saved_tensors
        gradient = gradients[0].contiguous()
        by_x = _times(gradient, weight) if ctx.needs_input_grad[0] else None
        return by_x, _times(gradient.t(), x), gradient.sum(0)


def _times(rows: Tensor, weight: Tensor) -> Tensor:
    """rows (M, K) @ weight (K, N), contiguous or transposed."""
    if _is_faster(rows, weight.shape[1]):
        return _by_onednn(rows, weight.t())
    return torch.mm(rows, weight)


def _is_faster(rows: Tensor, outputs: int) -> bool:
    if rows.device.type != "cpu" or rows.dtype != torch.float32:
        return False
    return rows.shape[0] * rows.shape[1] * outputs >= _LEAST and has_onednn()


@cache
def has_onednn() -> bool:
    """Whether products go by oneDNN here: on an AMD, with a torch that has the operation."""
    if vendor() != "AuthenticAMD" or not torch.backends.mkldnn.is_available():
        return False
    # torch's compiler calls it; should it be gone one day, MKL is still there.
    return hasattr(torch.ops.mkldnn, "_linear_pointwise")


def _by_onednn(rows: Tensor, weight: Tensor, bias: Tensor | None = None) -> Tensor:
    """rows (M, K) @ weight (N, K).T + bias (N,)."""
    found: Tensor = torch.ops.mkldnn._linear_pointwise(rows, weight, bias, "none", [], "")
    return found
