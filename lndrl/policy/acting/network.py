"""The built-in policy network in NumPy and compiled kernels, for whoever acts and never learns.

The same numbers, up to the order of sums, as ``networks.NavigationNetwork``, without torch: what
only acts starts two seconds sooner and in half of the memory. Weights lie as a product reads them
fastest, (inputs, outputs).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.config.learning import BUILT_IN, SCAN_ENCODERS
from lndrl.policy.arrays import ArrayInputs, pooling_factor, supports_sparse
from lndrl.policy.shapes import (
    fan_positions,
    goal_floats,
    has_plain_goal,
    last_cells,
    parameter_shapes,
    scan_positions,
)
from lndrl.policy.sparse import STAND_IN, MapStructure, stand_in_cells
from lndrl.policy.sparse.cells import cell_linear
from lndrl.policy.sparse.convolution import convolve_patches, weight_at_points
from lndrl.policy.sparse.first import convolve_first, tap_weight
from lndrl.policy.sparse.rows import Rows
from lndrl.policy.sparse.scan import ScanConvolutions

Tensors = Mapping[str, NDArray[np.float32]]

_EPSILON = 1e-5  # of torch's LayerNorm


def supports_arrays(config: RunConfig) -> bool:
    """Whether ``ArrayNetwork`` can be this network: all its parts are built in, its map sparse."""
    network = config.network
    if network.policy != BUILT_IN or network.scan_encoder not in SCAN_ENCODERS:
        return False
    return not network.pedestrian_map or supports_sparse(config)


class ArrayNetwork:
    """Logits of the policy of ``config`` with the weights ``tensors``.

    ``tensors`` has what ``shapes.parameter_shapes`` names, of which copies are made; without it
    they are zero. See ``supports_arrays``.
    """

    def __init__(self, config: RunConfig, tensors: Tensors | None = None) -> None:
        if tensors is None:
            shapes = parameter_shapes(config)
            tensors = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
        network = config.network
        self._map = _MapEncoder(config, tensors) if network.pedestrian_map else None
        fan = network.scan_encoder == "fan"
        self._scan = _FanEncoder(config, tensors) if fan else _ScanEncoder(config, tensors)
        self._goal = None if has_plain_goal(config) else _Dense("goal_encoder", tensors)
        scale = [1.0, 1.0, 1.0] + 3 * [network.variance_scale]
        self._scale = np.array(scale[: goal_floats(config)], np.float32)
        self._trunk = _Dense("trunk", tensors)
        self._norm = _Norm(tensors) if network.layer_norm else None
        self._head = _Dense("head", tensors)

    def __call__(self, inputs: ArrayInputs) -> NDArray[np.float32]:
        """Logits float32 (N, actions)."""
        parts = []
        if self._map is not None:
            assert isinstance(inputs.people, MapStructure)
            parts.append(self._map(inputs.people))
        parts.append(self._scan(inputs.scan))
        goal = inputs.goal[:, : len(self._scale)] * self._scale
        parts.append(goal if self._goal is None else _relu(self._goal(goal)))
        units = self._trunk(np.concatenate(parts, axis=1))
        return self._head(_relu(units if self._norm is None else self._norm(units)))


class _Dense:
    """A linear layer called ``name``."""

    def __init__(self, name: str, tensors: Tensors) -> None:
        self.weight = _kept(tensors[f"{name}.weight"].T)
        self.bias = _kept(tensors[f"{name}.bias"])

    def __call__(self, x: Rows) -> Rows:
        out = np.dot(x, self.weight)
        out += self.bias
        return out


class _Norm:
    """Layer normalization of the trunk's units."""

    def __init__(self, tensors: Tensors) -> None:
        self._weight, self._bias = _kept(tensors["norm.weight"]), _kept(tensors["norm.bias"])

    def __call__(self, x: Rows) -> Rows:
        centred = x - x.mean(axis=1, keepdims=True)
        spread = np.sqrt(np.square(centred).mean(axis=1, keepdims=True) + np.float32(_EPSILON))
        return centred / spread * self._weight + self._bias


class _ScanEncoder:
    """Scans (N, beams) -> (N, features); see ``networks.ScanEncoder``."""

    def __init__(self, config: RunConfig, tensors: Tensors) -> None:
        one, two, biases = _convolutions(tensors)
        self._convolve = ScanConvolutions(one[:, 0], biases[0], _flat(two), biases[1], (3, 2))
        self._linear = _by_position(tensors, scan_positions(config.world.laser.beams))

    def __call__(self, scan: Rows) -> Rows:
        return _relu(self._linear(_joined(self._convolve.by_position(scan))))


class _FanEncoder:
    """Scans (N, frames * beams) -> (N, features); see ``networks.FanScanEncoder``."""

    def __init__(self, config: RunConfig, tensors: Tensors) -> None:
        one, two, self._biases = _convolutions(tensors)
        self._frames = config.task.scan_frames
        self._weights = _flat(one), _flat(two)
        self._linear = _by_position(tensors, fan_positions(config.world.laser.beams))

    def __call__(self, scan: Rows) -> Rows:
        samples = len(scan)
        beams = scan.shape[1] // self._frames
        values = scan.reshape(samples, self._frames, beams).transpose(0, 2, 1) - np.float32(0.5)
        for weight, bias in zip(self._weights, self._biases, strict=True):
            channels = values.shape[2]
            padded = np.pad(values, ((0, 0), (1, 1), (0, 0)))
            seen = sliding_window_view(padded, len(weight) // channels, axis=1)[:, ::2]
            rows = seen.transpose(0, 1, 3, 2).reshape(-1, len(weight))
            values = _relu(np.dot(rows, weight) + bias).reshape(samples, seen.shape[1], len(bias))
        return _relu(self._linear(_joined(values)))


class _MapEncoder:
    """Structures of pedestrian maps -> (N, features); see ``networks.MapEncoder``."""

    def __init__(self, config: RunConfig, tensors: Tensors) -> None:
        pooling = pooling_factor(config)
        side = STAND_IN[pooling]
        x = np.zeros((3, side, side), np.float32)
        self._kernels: list[Rows] = []
        self._empty: list[tuple[Rows, Rows]] = []  # before and after ReLU and pooling
        for name in ("conv1", "conv2", "conv3"):
            weight = tensors[f"map_encoder.{name}.weight"]
            values = _convolved(x, weight, tensors[f"map_encoder.{name}.bias"])
            x = _pooled(_relu(values.copy()), pooling)
            self._empty.append((_as_rows(values), _as_rows(x)))
            first = name == "conv1"
            self._kernels.append(tap_weight(weight) if first else weight_at_points(weight))
        self._linear = _kept(tensors["map_encoder.linear.weight"].transpose(0, 2, 1))
        last = self._empty[-1][1][stand_in_cells(last_cells(config), pooling)]
        bias = tensors["map_encoder.linear.bias"]
        self._base = last.reshape(-1) @ self._linear.reshape(-1, len(bias)) + bias

    def __call__(self, s: MapStructure) -> Rows:
        rows, _ = convolve_first(s.values, self._kernels[0], *self._empty[0], s.levels[0])
        for weight, empty, level in zip(
            self._kernels[1:], self._empty[1:], s.levels[1:], strict=True
        ):
            rows = convolve_patches(rows, weight, *empty, level).out
        return _relu(cell_linear(rows, self._linear, self._base, s))


def _convolutions(tensors: Tensors) -> tuple[Rows, Rows, tuple[Rows, Rows]]:
    """Of a scan encoder, with taps first: (taps, inputs, outputs) twice, and both biases."""
    one, two = (
        _kept(tensors[f"scan_encoder.{name}.weight"].transpose(2, 1, 0))
        for name in ("conv1", "conv2")
    )
    names = "scan_encoder.conv1.bias", "scan_encoder.conv2.bias"
    return one, two, (_kept(tensors[names[0]]), _kept(tensors[names[1]]))


def _flat(weight: Rows) -> Rows:
    """(taps * inputs, outputs)."""
    return weight.reshape(-1, weight.shape[2])


def _by_position(tensors: Tensors, positions: int) -> _Dense:
    """The scan's linear layer for channels side by side at each position."""
    name = "scan_encoder.linear"
    weight = tensors[f"{name}.weight"]
    by_position = weight.reshape(len(weight), -1, positions).transpose(0, 2, 1)
    moved = {f"{name}.weight": by_position.reshape(len(weight), -1)}
    return _Dense(name, {**tensors, **moved})


def _convolved(x: Rows, weight: Rows, bias: Rows) -> Rows:
    """A 3x3 convolution of one map (C, S, S), zero around, densely: (O, S, S)."""
    padded = np.pad(x, ((0, 0), (1, 1), (1, 1)))
    seen = sliding_window_view(padded, (3, 3), axis=(1, 2)).transpose(0, 3, 4, 1, 2)
    out = weight.reshape(len(weight), -1) @ seen.reshape(-1, x.shape[1] * x.shape[2])
    return (out + bias[:, None]).reshape(-1, *x.shape[1:])


def _pooled(x: Rows, pooling: int) -> Rows:
    channels, side, _ = x.shape
    return x.reshape(channels, side // pooling, pooling, side // pooling, pooling).max((2, 4))


def _as_rows(x: Rows) -> Rows:
    """(C, S, S) as (S * S, C)."""
    return np.ascontiguousarray(x.reshape(len(x), -1).T)


def _joined(x: Rows) -> Rows:
    """(N, positions, channels) as (N, positions * channels), of no samples, too."""
    return x.reshape(len(x), x.shape[1] * x.shape[2])


def _kept(x: Rows) -> Rows:
    """A contiguous copy: views of a blob would keep the whole of it."""
    return np.array(x, np.float32, order="C")


def _relu(x: Rows) -> Rows:
    return np.maximum(x, 0.0, out=x)
