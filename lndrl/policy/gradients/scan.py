"""The two convolutions of the scan encoder on the CPU, exact up to the order of sums."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd import Function

from lndrl.policy.sparse.scan import ScanConvolutions


class _ScanConvolutions(Function):
    """Conv1d, ReLU, Conv1d, ReLU, without padding: scan (N, beams) -> (N, C2 * L2)."""

    @staticmethod
    def forward(
        ctx: Any,
        scan: Tensor,
        weight1: Tensor,
        bias1: Tensor,
        weight2: Tensor,
        bias2: Tensor,
        strides: tuple[int, int],
    ) -> Tensor:
        channels, inputs, taps = weight2.shape
        flat2 = weight2.permute(2, 1, 0).reshape(taps * inputs, channels)
        ctx.layers = ScanConvolutions(
            _array(weight1[:, 0].t()), _array(bias1), _array(flat2), _array(bias2), strides
        )
        out = torch.from_numpy(ctx.layers.by_channel(scan.numpy()))
        ctx.save_for_backward(scan, out)
        ctx.taps = taps
        return out.flatten(1)

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        scan, out = ctx.saved_tensors
        gradient = gradients[0].contiguous().view_as(out).numpy()
        found = ctx.layers.gradients(gradient, out.numpy(), scan.numpy())
        weight1, bias1, weight2, bias2 = (torch.from_numpy(each) for each in found)
        by_weight2 = weight2.view(ctx.taps, -1, out.shape[1]).permute(2, 1, 0)
        return None, weight1.t().unsqueeze(1), bias1, by_weight2, bias2, None


def _array(weight: Tensor) -> NDArray[np.float32]:
    # Weights in bfloat16 are multiplied in float32, too: the layer after them is what counts.
    found: NDArray[np.float32] = weight.detach().float().contiguous().numpy()
    return found


def scan_convolutions(
    scan: Tensor,
    weight1: Tensor,
    bias1: Tensor,
    weight2: Tensor,
    bias2: Tensor,
    strides: tuple[int, int],
) -> Tensor:
    """Both convolutions with their ReLU: weight1 (C1, 1, K1), weight2 (C2, C1, K2)."""
    found: Tensor = _ScanConvolutions.apply(scan, weight1, bias1, weight2, bias2, strides)
    return found
