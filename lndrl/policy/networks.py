"""The paper's policy and value networks (PAPER §III-B; pooling and padding from GROUP).

Pedestrian map 3x48x48 -> three 3x3 convolutions with ReLU and 2x2 max-pooling -> 512; scan 1x720
-> two 1D convolutions -> 512; belief over the goal 6 -> 64; all joined -> 512 -> head. Two ways
to evaluate the same weights: dense tensors (GPU, ``pooling: none``, the reference) and the
sparse pedestrian encoder (CPU), which is exact up to the order of sums.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812  (torch's own convention)

from lndrl.config import RunConfig
from lndrl.config.learning import BUILT_IN, SCAN_ENCODERS
from lndrl.extensions import ENCODER, NETWORK, find
from lndrl.navigation import action_table
from lndrl.navigation.privileged.floats import NAMES
from lndrl.policy.arrays import pooling_factor
from lndrl.policy.gradients import (
    cell_linear,
    convolve_first,
    convolve_patches,
    convolve_pool,
    flat_weight,
    linear,
    scan_convolutions,
    tap_weight,
    train_cell_linear,
    weight_at_points,
)
from lndrl.policy.inputs import Inputs
from lndrl.policy.own import OwnEncoder, OwnNetwork
from lndrl.policy.shapes import (
    FAN_SCAN_FEATURES,
    FAN_TRUNK_FEATURES,
    SCAN_CHANNELS,
    fan_positions,
    goal_floats,
    has_plain_goal,
    last_cells,
    scan_positions,
)
from lndrl.policy.sparse import STAND_IN, MapStructure, stand_in_cells


@dataclass(frozen=True)
class EmptyResponse:
    """What a convolution of the map encoder makes of a map without people.

    Rows of the stand-in's cells: ``conv`` (before) and ``pooled`` (after ReLU and pooling).
    """

    conv: Tensor
    pooled: Tensor


@dataclass(frozen=True)
class FrozenWeights:
    """What the sparse evaluation needs of weights that stay as they are for a while."""

    empty: list[EmptyResponse]
    cut: bool  # whether they are for rows cut into patches
    kernels: list[Tensor]  # see tap_weight; from the second on weight_at_points or flat_weight
    base: Tensor  # (features,), the linear layer's response to the empty map


class CellLinear(nn.Module):
    """A linear layer over a whole map (N, cells, channels) -> (N, features).

    Its weights are kept cell by cell, (cells, features, channels), so that the sparse evaluation
    reads those of a cell in one piece.
    """

    def __init__(self, cells: int, channels: int, features: int) -> None:
        super().__init__()
        linear = nn.Linear(cells * channels, features)
        self.weight = nn.Parameter(torch.empty(cells, features, channels))
        self.bias = linear.bias
        self.set_matrix(linear.weight)

    def forward(self, x: Tensor) -> Tensor:
        return F.linear(x.flatten(1), self.weight.transpose(0, 1).flatten(1), self.bias)

    def set_matrix(self, matrix: Tensor) -> None:
        """Take the weights (features, cells * channels) of an ordinary linear layer."""
        with torch.no_grad():
            cells, features, channels = self.weight.shape
            self.weight.copy_(matrix.view(features, cells, channels).transpose(0, 1))


class MapEncoder(nn.Module):
    """Pedestrian map (N, 3, S, S) -> (N, features)."""

    def __init__(self, config: RunConfig) -> None:
        super().__init__()
        first, second, third = config.network.map_channels
        self.pooling = pooling_factor(config)
        self.conv1 = nn.Conv2d(3, first, 3, padding=1)
        self.conv2 = nn.Conv2d(first, second, 3, padding=1)
        self.conv3 = nn.Conv2d(second, third, 3, padding=1)
        self.cells = last_cells(config)
        self.features = config.network.features
        self.linear = CellLinear(self.cells**2, third, self.features)
        self._frozen: FrozenWeights | None = None

    def forward(self, people: Tensor | MapStructure) -> Tensor:
        if isinstance(people, MapStructure):
            return F.relu(self._sparse(people))
        return F.relu(self.linear(self._dense(people)))

    def freeze(self) -> None:
        """Keep what depends on the weights alone, for calls without gradients.

        To be called again whenever the weights change.
        """
        with torch.no_grad():
            empty = self._empty_response()
            last = empty[-1].pooled[torch.from_numpy(stand_in_cells(self.cells, self.pooling))]
            kind = self.conv1.weight.dtype
            cut = kind == torch.float32
            base = self.linear(last.to(kind)[None])[0].float()
            self._frozen = FrozenWeights(empty, cut, self._kernels(cut), base)

    def _dense(self, maps: Tensor) -> Tensor:
        x = maps
        for convolution in self._convolutions():
            x = self._pool(F.relu(convolution(x)))
        return x.flatten(2).transpose(1, 2)

    def _sparse(self, s: MapStructure) -> Tensor:
        frozen = None if torch.is_grad_enabled() else self._frozen
        empty = frozen.empty if frozen else self._empty_response()
        cut = s.levels[1].patches is not None
        kernels = frozen.kernels if frozen and frozen.cut == cut else self._kernels(cut)
        others = convolve_patches if cut else convolve_pool
        rows = torch.from_numpy(s.values)
        for i, level in enumerate(s.levels):
            convolve = others if i else convolve_first
            rows = convolve(rows, kernels[i], empty[i].conv, empty[i].pooled, level)
        if frozen:
            return cell_linear(rows, self.linear.weight, frozen.base, s)
        last = empty[-1].pooled[torch.from_numpy(s.cell_stand_in)]
        return train_cell_linear(rows, last, self.linear.weight, self.linear.bias, s)

    def _kernels(self, cut: bool) -> list[Tensor]:
        """The convolutions' weights as the sparse evaluation takes them; ``cut`` into patches."""
        first, *others = (convolution.weight for convolution in self._convolutions())
        arranged = (weight_at_points(w.float()) if cut else flat_weight(w) for w in others)
        return [tap_weight(first), *arranged]

    def _empty_response(self) -> list[EmptyResponse]:
        """The dense convolutions on the stand-in."""
        side = STAND_IN[self.pooling]
        x = self.conv1.weight.new_zeros(1, 3, side, side)
        found = []
        for convolution in self._convolutions():
            # Unfolded by hand: torch's convolutions are slow on a single small map.
            assert convolution.bias is not None
            weight, bias = convolution.weight.flatten(1), convolution.bias[:, None]
            values = (weight @ F.unfold(x, 3, padding=1) + bias).view(1, -1, *x.shape[2:])
            x = self._pool(F.relu(values))
            rows = (v[0].flatten(1).t().float().contiguous() for v in (values, x))
            found.append(EmptyResponse(*rows))
        return found

    def _convolutions(self) -> tuple[nn.Conv2d, nn.Conv2d, nn.Conv2d]:
        return self.conv1, self.conv2, self.conv3

    def _pool(self, x: Tensor) -> Tensor:
        return F.max_pool2d(x, self.pooling) if self.pooling > 1 else x


class ScanEncoder(nn.Module):
    """Scan (N, beams) in [0, 1] -> (N, features)."""

    def __init__(self, config: RunConfig) -> None:
        super().__init__()
        self.conv1 = nn.Conv1d(1, SCAN_CHANNELS, 5, stride=3)
        self.conv2 = nn.Conv1d(SCAN_CHANNELS, SCAN_CHANNELS, 3, stride=2)
        positions = scan_positions(config.world.laser.beams)
        self.features = config.network.features
        self.linear = nn.Linear(SCAN_CHANNELS * positions, self.features)

    def forward(self, scan: Tensor) -> Tensor:
        one, two = self.conv1, self.conv2
        # Of compiled kernels nothing would be left in a graph that is exported.
        if scan.device.type == "cpu" and not torch.compiler.is_exporting():
            assert one.bias is not None and two.bias is not None
            strides = one.stride[0], two.stride[0]
            x = scan_convolutions(scan, one.weight, one.bias, two.weight, two.bias, strides)
        else:
            x = F.relu(two(self.first(scan))).flatten(1)
        return F.relu(linear(self.linear, x))

    def first(self, scan: Tensor) -> Tensor:
        """The first convolution after its ReLU, (N, 32, positions)."""
        return F.relu(self.conv1(scan.unsqueeze(1)))


class FanScanEncoder(nn.Module):
    """Scans (N, frames * beams) in [0, 1] -> (N, features): DRL_laser's encoder (§7.1)."""

    def __init__(self, config: RunConfig) -> None:
        super().__init__()
        self.frames = config.task.scan_frames
        self.conv1 = nn.Conv1d(self.frames, SCAN_CHANNELS, 5, stride=2, padding=1)
        self.conv2 = nn.Conv1d(SCAN_CHANNELS, SCAN_CHANNELS, 3, stride=2, padding=1)
        positions = fan_positions(config.world.laser.beams)
        self.features = FAN_SCAN_FEATURES
        self.linear = nn.Linear(SCAN_CHANNELS * positions, self.features)

    def forward(self, scan: Tensor) -> Tensor:
        x = F.relu(self.conv2(self.first(scan)))
        return F.relu(linear(self.linear, x.flatten(1)))

    def first(self, scan: Tensor) -> Tensor:
        """The first convolution after its ReLU, (N, 32, positions)."""
        return F.relu(self.conv1(scan.unflatten(1, (self.frames, -1)) - 0.5))


class NavigationNetwork(nn.Module):
    """Encoders, trunk and a linear head of ``outputs`` units.

    ``config.network`` may leave the pedestrian map or the variances out, or read several scans the
    way DRL_laser does; without a map that network is Fan et al.'s whole one, whose trunk reads the
    goal itself. Either encoder may be a class of the user's own. ``privileged`` is how many
    privileged floats it reads, too; the trunk's last columns are theirs.
    """

    goal_scale: Tensor

    def __init__(self, config: RunConfig, outputs: int, privileged: int = 0) -> None:
        super().__init__()
        network = config.network
        self.outputs = outputs
        self.goals = goal_floats(config)
        self.map_encoder = map_encoder(config) if network.pedestrian_map else None
        self.scan_encoder = scan_encoder(config)
        plain = has_plain_goal(config)
        self.goal_encoder = None if plain else nn.Linear(self.goals, network.goal_features)
        joined = self.scan_encoder.features
        joined += self.goals if plain else network.goal_features
        joined += 0 if self.map_encoder is None else self.map_encoder.features
        self.privileged_encoder: nn.Linear | None = None
        if privileged:
            self.privileged_encoder = nn.Linear(privileged, network.goal_features)
            joined += network.goal_features
        trunk = FAN_TRUNK_FEATURES if plain else network.features
        self.trunk = nn.Linear(joined, trunk)
        self.norm = nn.LayerNorm(trunk) if network.layer_norm else None
        self.head = nn.Linear(trunk, outputs)
        scale = torch.tensor([1.0, 1.0, 1.0] + 3 * [network.variance_scale])
        self.register_buffer("goal_scale", scale[: self.goals], persistent=False)

    def forward(self, inputs: Inputs) -> Tensor:
        """Head outputs float32 (N, outputs) before any softmax; autocast may surround it."""
        device = inputs.scan.device.type
        # The sparse kernels know float32 only.
        dense = torch.is_autocast_enabled(device) and isinstance(inputs.people, Tensor)
        parts: list[Tensor] = []
        if self.map_encoder is not None:
            with torch.autocast(device, enabled=dense, cache_enabled=False):
                parts.append(self.map_encoder(inputs.people))
        parts.append(self.scan_encoder(inputs.scan))
        goal = inputs.goal[:, : self.goals] * self.goal_scale
        parts.append(goal if self.goal_encoder is None else F.relu(self.goal_encoder(goal)))
        if self.privileged_encoder is not None:
            if inputs.privileged is None:
                raise ValueError("this value network needs privileged floats in its inputs")
            parts.append(F.relu(self.privileged_encoder(inputs.privileged)))
        units = linear(self.trunk, torch.cat(parts, dim=1))
        trunk = F.relu(units if self.norm is None else self.norm(units))
        # Values and log-probabilities with the eight bits of bfloat16 would be too coarse.
        with torch.autocast(device, enabled=False):
            return self.head(trunk.float())

    def freeze(self) -> None:
        """Keep what depends on the weights alone; again after every change of them."""
        if isinstance(self.map_encoder, MapEncoder):
            self.map_encoder.freeze()

    def coarse(self) -> NavigationNetwork:
        """A copy that multiplies in bfloat16."""
        copied = copy.deepcopy(self).bfloat16()
        copied.head.float()  # eight bits would be too coarse for log-probabilities
        return copied


Network = NavigationNetwork | OwnNetwork


def scan_encoder(config: RunConfig) -> ScanEncoder | FanScanEncoder | OwnEncoder:
    """The scan encoder of ``config``; raises UserError for one that is not to be had."""
    network = config.network
    where = "network.scan_encoder"
    if find(ENCODER, network.scan_encoder, SCAN_ENCODERS, where) is None:
        return FanScanEncoder(config) if network.scan_encoder == "fan" else ScanEncoder(config)
    values = config.task.scan_frames * config.world.laser.beams
    settings = dict(network.scan_encoder_settings)
    return OwnEncoder(config, network.scan_encoder, settings, where, (values,))


def map_encoder(config: RunConfig) -> MapEncoder | OwnEncoder:
    """The map encoder of ``config``; raises UserError for one that is not to be had."""
    network, side = config.network, config.task.map_cells
    where = "network.map_encoder"
    if find(ENCODER, network.map_encoder, (BUILT_IN,), where) is None:
        return MapEncoder(config)
    settings = dict(network.map_encoder_settings)
    return OwnEncoder(config, network.map_encoder, settings, where, (3, side, side))


def build_policy(config: RunConfig, initialize: bool = True) -> Network:
    """The policy: logits over the actions; 7,615,804 parameters with the paper's numbers.

    Without ``initialize`` its weights are any, for whoever loads others: orthogonal ones take half
    a second and twice their room. Raises UserError for parts of a user's own that are not trusted
    or not what they should be.
    """
    actions = action_table(config.task)
    if find(NETWORK, config.network.policy, (BUILT_IN,), "network.policy") is not None:
        return OwnNetwork(config, len(actions))
    network = NavigationNetwork(config, len(actions))
    if not initialize:
        return network
    _initialized(network, config, head_gain=0.01)
    if config.network.turn_reluctance:
        # A policy that turns at random soon gets lost, and then learns from little else.
        turns = torch.from_numpy(np.abs(actions[:, 1])).float()
        with torch.no_grad():
            network.head.bias.sub_(config.network.turn_reluctance * turns)
    return network


def build_value(config: RunConfig) -> Network:
    """The value network: one linear unit; 7,601,953 parameters with the paper's numbers.

    With ``learner.privileged_critic`` an encoder of the privileged floats more.
    """
    if find(NETWORK, config.network.policy, (BUILT_IN,), "network.policy") is not None:
        return OwnNetwork(config, 1)
    privileged = len(NAMES) if config.learner.privileged_critic else 0
    return _initialized(NavigationNetwork(config, 1, privileged), config, head_gain=1.0)


def _initialized(
    network: NavigationNetwork, config: RunConfig, head_gain: float
) -> NavigationNetwork:
    if config.network.initialization == "orthogonal":
        foreign = {
            inner
            for module in network.modules()
            if isinstance(module, OwnEncoder)
            for inner in module.modules()
        }
        for module in network.modules():
            if module in foreign:
                continue  # whoever wrote it has initialized it
            if isinstance(module, nn.Conv1d | nn.Conv2d | nn.Linear):
                gain = head_gain if module is network.head else float(np.sqrt(2.0))
                nn.init.orthogonal_(module.weight, gain)
                assert module.bias is not None
                nn.init.zeros_(module.bias)
            elif isinstance(module, CellLinear):
                cells, features, channels = module.weight.shape
                matrix = torch.empty(features, cells * channels)
                module.set_matrix(nn.init.orthogonal_(matrix, float(np.sqrt(2.0))))
                nn.init.zeros_(module.bias)
    return network
