"""The two convolutions of the scan encoder on the CPU, exact up to the order of sums.

With 1 and 32 channels they are too small for a general library, which takes a third of the
learner's time for a twentieth of its arithmetic. Here the first runs in a compiled kernel that
leaves its output as the second one's windows, side by side; the second is one matrix product.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.kernels import kernel
from lndrl.policy.sparse.rows import Rows

CHUNK = 16  # scans at a time, so that their windows stay in the cache


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


@dataclass(frozen=True)
class ScanConvolutions:
    """Two convolutions with ReLU and without padding, of scans (N, beams).

    weight1 (K1, C1), bias1 (C1,); weight2 (K2 * C1, C2), bias2 (C2,); strides of both. All
    contiguous float32.
    """

    weight1: Rows
    bias1: Rows
    weight2: Rows
    bias2: Rows
    strides: tuple[int, int]

    def positions(self, beams: int) -> tuple[int, int]:
        """How many outputs per channel the two convolutions have of a scan, (L1, L2)."""
        first = (beams - len(self.weight1)) // self.strides[0] + 1
        taps = len(self.weight2) // len(self.bias1)
        return first, (first - taps) // self.strides[1] + 1

    def by_position(self, scan: NDArray[np.float32]) -> NDArray[np.float32]:
        """(N, L2, C2): as the products come out."""
        out = np.empty((len(scan), self.positions(scan.shape[1])[1], len(self.bias2)), np.float32)
        for rows, seen in self._windows(scan):
            values = out[rows].reshape(-1, len(self.bias2))
            np.dot(seen, self.weight2, out=values)
            values += self.bias2
            np.maximum(values, 0.0, out=values)
        return out

    def by_channel(self, scan: NDArray[np.float32]) -> NDArray[np.float32]:
        """(N, C2, L2): as torch has it."""
        out = np.empty((len(scan), len(self.bias2), self.positions(scan.shape[1])[1]), np.float32)
        for rows, seen in self._windows(scan):
            values = np.dot(seen, self.weight2)
            values += self.bias2
            _relu_by_channel(values.reshape(-1, out.shape[2], out.shape[1]), out[rows])
        return out

    def gradients(
        self, gradient: NDArray[np.float32], out: NDArray[np.float32], scan: NDArray[np.float32]
    ) -> tuple[Rows, Rows, Rows, Rows]:
        """By weight1, bias1, weight2 and bias2, from that by ``out``, the result of by_channel."""
        weight1, bias1 = np.zeros_like(self.weight1), np.zeros_like(self.bias1)
        weight2, bias2 = np.zeros_like(self.weight2), np.zeros_like(self.bias2)
        hidden = np.empty((self.positions(scan.shape[1])[0], len(bias1)), np.float32)
        # The windows are made again: twice the room in the cache is dearer than the arithmetic.
        for rows, seen in self._windows(scan):
            values = np.empty((len(out[rows]), out.shape[2], out.shape[1]), np.float32)
            _relu_by_position(gradient[rows], out[rows], values)
            flat = values.reshape(-1, len(bias2))
            weight2 += np.dot(seen.T, flat)
            bias2 += flat.sum(0)
            shape = (len(values), -1, len(weight2))
            by_window = np.dot(flat, self.weight2.T).reshape(shape)
            windows = seen.reshape(shape)
            windows_gradient(by_window, windows, scan[rows], *self.strides, hidden, weight1, bias1)
        return weight1, bias1, weight2, bias2

    def _windows(self, scan: NDArray[np.float32]) -> Iterator[tuple[slice, Rows]]:
        """Rows of some scans, and what the second convolution reads of them.

        That is (n * L2, K2 * C1), in memory that the next ones take.
        """
        first, second = self.positions(scan.shape[1])
        hidden = np.empty((first, len(self.bias1)), np.float32)
        room = np.empty((CHUNK, second, len(self.weight2)), np.float32)
        for begin in range(0, len(scan), CHUNK):
            part = scan[begin : begin + CHUNK]
            seen = room[: len(part)]
            _windows(part, self.weight1, self.bias1, *self.strides, hidden, seen)
            yield slice(begin, begin + len(part)), seen.reshape(-1, len(self.weight2))


KERNELS = (_windows,)
"""What acting calls from Python."""
COARSE_KERNELS = (_relu_by_channel,)
"""What acting by torch calls beside these."""
