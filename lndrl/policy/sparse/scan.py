"""The two convolutions of the scan encoder on the CPU, exact up to the order of sums.

With 1 and 32 channels they are too small for a general library, which takes a third of the
learner's time for a twentieth of its arithmetic. Here the first runs in a compiled kernel that
leaves its output as the second one's windows, side by side; the second is one matrix product.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function

from lndrl.kernels import kernel
from lndrl.policy.sparse.products import times
from lndrl.policy.sparse.rows import product

_CHUNK = 16  # scans at a time, so that their windows stay in the cache


@kernel()
def _windows(scan, weight, bias, stride, step, hidden, out):
    """ReLU of the first convolution, as the windows that the second one reads.

    scan (N, beams), weight (K1, C), hidden scratch (L1, C), out (N, L2, K2 * C).
    """
    length, channels = hidden.shape
    for n in range(scan.shape[0]):
        for i in range(length):
            for c in range(channels):
                hidden[i, c] = bias[c]
            for k in range(weight.shape[0]):
                x = scan[n, i * stride + k]
                for c in range(channels):
                    hidden[i, c] += weight[k, c] * x
            for c in range(channels):
                hidden[i, c] = max(hidden[i, c], 0.0)
        for i in range(out.shape[1]):
            for k in range(out.shape[2] // channels):
                for c in range(channels):
                    out[n, i, k * channels + c] = hidden[i * step + k, c]


@kernel()
def _relu_by_channel(values, out):
    """out[n, c, i] = relu(values[n, i, c])."""
    for n in range(values.shape[0]):
        for i in range(values.shape[1]):
            for c in range(values.shape[2]):
                out[n, c, i] = max(values[n, i, c], 0.0)


@kernel()
def _relu_by_position(gradient, output, out):
    """The gradient of ``_relu_by_channel``, whose result was ``output``."""
    for n in range(out.shape[0]):
        for i in range(out.shape[1]):
            for c in range(out.shape[2]):
                out[n, i, c] = gradient[n, c, i] if output[n, c, i] > 0.0 else 0.0


@kernel()
def windows_gradient(gradient, windows, scan, stride, step, hidden, weight, bias):
    """Adds the gradients of ``_windows`` to weight (K1, C) and bias (C,); hidden as there."""
    length, channels = hidden.shape
    for n in range(scan.shape[0]):
        for i in range(length):
            for c in range(channels):
                hidden[i, c] = 0.0
        for i in range(windows.shape[1]):
            for k in range(windows.shape[2] // channels):
                for c in range(channels):
                    at = k * channels + c
                    passed = windows[n, i, at] > 0.0
                    hidden[i * step + k, c] += gradient[n, i, at] if passed else 0.0
        for i in range(length):
            for k in range(weight.shape[0]):
                x = scan[n, i * stride + k]
                for c in range(channels):
                    weight[k, c] += hidden[i, c] * x
            for c in range(channels):
                bias[c] += hidden[i, c]


class ScanConvolutions(Function):
    """Conv1d, ReLU, Conv1d, ReLU, without padding: scan (N, beams) -> (N, C2 * L2).

    weight1 (C1, 1, K1), weight2 (C2, C1, K2), biases (C1,) and (C2,), strides of both.
    """

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
        flat1, bias1 = weight1.detach()[:, 0].t().float().contiguous(), bias1.detach().float()
        first = _First(flat1, bias1, *strides)
        channels, inputs, kernel = weight2.shape
        flat2 = weight2.detach().permute(2, 1, 0).reshape(kernel * inputs, channels)
        hidden, windows = first.buffers(scan.shape[1], kernel)
        out = torch.empty(len(scan), channels, windows.shape[1])
        for begin in range(0, len(scan), _CHUNK):
            part, into = scan[begin : begin + _CHUNK], out[begin : begin + _CHUNK]
            seen = windows[: len(part)]
            first.windows(part, hidden, seen)
            multiply = times if flat2.dtype == torch.float32 else product
            values = multiply(seen.view(-1, len(flat2)), flat2).add_(bias2)
            _relu_by_channel(values.view(len(part), -1, channels).numpy(), into.numpy())
        ctx.save_for_backward(scan, out, flat2)
        ctx.first, ctx.kernel = first, kernel
        return out.flatten(1)

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Tensor | None, ...]:
        scan, out, flat2 = ctx.saved_tensors
        first: _First = ctx.first
        gradient = gradients[0].contiguous().view_as(out)
        # The windows are made again: twice the room in the cache is dearer than the arithmetic.
        hidden, windows = first.buffers(scan.shape[1], ctx.kernel)
        weight1, bias1 = torch.zeros_like(first.weight), torch.zeros_like(first.bias)
        weight2, bias2 = torch.zeros_like(flat2), torch.zeros(out.shape[1])
        for begin in range(0, len(scan), _CHUNK):
            rows = slice(begin, begin + _CHUNK)
            part = scan[rows]
            seen = windows[: len(part)]
            first.windows(part, hidden, seen)
            values = torch.empty(len(part), out.shape[2], out.shape[1])
            _relu_by_position(gradient[rows].numpy(), out[rows].numpy(), values.numpy())
            values = values.view(-1, out.shape[1])
            weight2 += times(seen.view(-1, len(flat2)).t(), values)
            bias2 += values.sum(0)
            by_window = times(values, flat2.t()).view_as(seen)
            first.gradient(by_window, seen, part, hidden, weight1, bias1)
        by_weight2 = weight2.view(ctx.kernel, -1, out.shape[1]).permute(2, 1, 0)
        return None, weight1.t().unsqueeze(1), bias1, by_weight2, bias2, None


@dataclass(frozen=True)
class _First:
    """The first convolution: weight (K1, C), bias (C,), its stride and the second one's."""

    weight: Tensor
    bias: Tensor
    stride: int
    step: int

    def buffers(self, beams: int, kernel: int) -> tuple[Tensor, Tensor]:
        """Scratch of one scan and room for the windows of _CHUNK scans."""
        length = (beams - len(self.weight)) // self.stride + 1
        windows = (length - kernel) // self.step + 1
        channels = len(self.bias)
        return torch.empty(length, channels), torch.empty(_CHUNK, windows, kernel * channels)

    def windows(self, scan: Tensor, hidden: Tensor, out: Tensor) -> None:
        _windows(
            scan.numpy(),
            self.weight.numpy(),
            self.bias.numpy(),
            self.stride,
            self.step,
            hidden.numpy(),
            out.numpy(),
        )

    def gradient(
        self,
        by_window: Tensor,
        windows: Tensor,
        scan: Tensor,
        hidden: Tensor,
        weight: Tensor,
        bias: Tensor,
    ) -> None:
        windows_gradient(
            by_window.numpy(),
            windows.numpy(),
            scan.numpy(),
            self.stride,
            self.step,
            hidden.numpy(),
            weight.numpy(),
            bias.numpy(),
        )


def scan_convolutions(
    scan: Tensor,
    weight1: Tensor,
    bias1: Tensor,
    weight2: Tensor,
    bias2: Tensor,
    strides: tuple[int, int],
) -> Tensor:
    """Both convolutions of the scan encoder; see ScanConvolutions."""
    return ScanConvolutions.apply(scan, weight1, bias1, weight2, bias2, strides)


KERNELS = (_windows, _relu_by_channel)
"""What acting calls from Python."""
