"""The paper's policy and value networks (PAPER §III-B; pooling and padding from GROUP).

Pedestrian map 3x48x48 -> three 3x3 convolutions with ReLU and 2x2 max-pooling -> 512; scan 1x720
-> two 1D convolutions -> 512; belief over the goal 6 -> 64; all joined -> 512 -> head. Two ways
to evaluate the same weights: dense tensors (GPU, ``pooling: none``, the reference) and the
sparse pedestrian encoder (CPU), which is exact up to the order of sums.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812  (torch's own convention)

from lndrl.config import RunConfig
from lndrl.navigation import action_table
from lndrl.policy.inputs import Inputs
from lndrl.policy.sparse import gather_convolution, gather_pool, gather_rows
from lndrl.policy.structure import MapStructure


class MapEncoder(nn.Module):
    """Pedestrian map (N, 3, S, S) -> (N, features)."""

    def __init__(self, config: RunConfig) -> None:
        super().__init__()
        first, second, third = config.network.map_channels
        self.pooling = config.network.pooling == "max"
        self.conv1 = nn.Conv2d(3, first, 3, padding=1)
        self.conv2 = nn.Conv2d(first, second, 3, padding=1)
        self.conv3 = nn.Conv2d(second, third, 3, padding=1)
        cells = config.task.map_cells // 8 if self.pooling else config.task.map_cells
        self.linear = nn.Linear(third * cells * cells, config.network.features)

    def forward(self, people: Tensor | MapStructure) -> Tensor:
        last = self._sparse(people) if isinstance(people, MapStructure) else self._dense(people)
        return F.relu(self.linear(last))

    def _dense(self, maps: Tensor) -> Tensor:
        x = maps
        for convolution in (self.conv1, self.conv2, self.conv3):
            x = F.relu(convolution(x))
            if self.pooling:
                x = F.max_pool2d(x, 2)
        # Cell-major order, so that the sparse path gathers whole rows of channels.
        return x.permute(0, 2, 3, 1).flatten(1)

    def _sparse(self, s: MapStructure) -> Tensor:
        values = F.linear(
            torch.from_numpy(s.patches), self.conv1.weight.flatten(1), self.conv1.bias
        )
        pooled = gather_pool(values, s.pool1)
        for convolution, windows, blocks in (
            (self.conv2, s.conv2, s.pool2),
            (self.conv3, s.conv3, s.pool3),
        ):
            weight = convolution.weight.permute(0, 2, 3, 1).flatten(1)
            assert convolution.bias is not None
            values = gather_convolution(pooled, windows, weight, convolution.bias)
            pooled = gather_pool(values, blocks)
        return gather_rows(pooled, s.features)


class ScanEncoder(nn.Module):
    """Scan (N, beams) in [0, 1] -> (N, features)."""

    def __init__(self, config: RunConfig) -> None:
        super().__init__()
        self.conv1 = nn.Conv1d(1, 32, 5, stride=3)
        self.conv2 = nn.Conv1d(32, 32, 3, stride=2)
        width = ((config.world.laser.beams - 5) // 3 + 1 - 3) // 2 + 1
        self.linear = nn.Linear(32 * width, config.network.features)

    def forward(self, scan: Tensor) -> Tensor:
        x = F.relu(self.conv1(scan.unsqueeze(1)))
        x = F.relu(self.conv2(x))
        return F.relu(self.linear(x.flatten(1)))


class NavigationNetwork(nn.Module):
    """Encoders, trunk and a linear head of ``outputs`` units."""

    def __init__(self, config: RunConfig, outputs: int) -> None:
        super().__init__()
        network = config.network
        self.map_encoder = MapEncoder(config)
        self.scan_encoder = ScanEncoder(config)
        self.goal_encoder = nn.Linear(6, network.goal_features)
        self.trunk = nn.Linear(2 * network.features + network.goal_features, network.features)
        self.head = nn.Linear(network.features, outputs)

    def forward(self, inputs: Inputs) -> Tensor:
        """Head outputs float32 (N, outputs) before any softmax; autocast may surround it."""
        device = inputs.scan.device.type
        # The sparse kernels know float32 only.
        dense = torch.is_autocast_enabled(device) and isinstance(inputs.people, Tensor)
        with torch.autocast(device, enabled=dense, cache_enabled=False):
            people = self.map_encoder(inputs.people)
        joined = torch.cat(
            (people, self.scan_encoder(inputs.scan), F.relu(self.goal_encoder(inputs.goal))), dim=1
        )
        trunk = F.relu(self.trunk(joined))
        # Values and log-probabilities with the eight bits of bfloat16 would be too coarse.
        with torch.autocast(device, enabled=False):
            return self.head(trunk.float())


def build_policy(config: RunConfig) -> NavigationNetwork:
    """The policy: logits over the actions; 7,615,804 parameters with the paper's numbers."""
    actions = action_table(config.task)
    network = _initialized(NavigationNetwork(config, len(actions)), config, head_gain=0.01)
    if config.network.turn_reluctance:
        # A policy that turns at random soon gets lost, and then learns from little else.
        turns = torch.from_numpy(np.abs(actions[:, 1])).float()
        with torch.no_grad():
            network.head.bias.sub_(config.network.turn_reluctance * turns)
    return network


def build_value(config: RunConfig) -> NavigationNetwork:
    """The value network: one linear unit; 7,601,953 parameters with the paper's numbers."""
    return _initialized(NavigationNetwork(config, 1), config, head_gain=1.0)


def _initialized(
    network: NavigationNetwork, config: RunConfig, head_gain: float
) -> NavigationNetwork:
    if config.network.initialization == "orthogonal":
        for module in network.modules():
            if isinstance(module, nn.Conv1d | nn.Conv2d | nn.Linear):
                gain = head_gain if module is network.head else float(np.sqrt(2.0))
                nn.init.orthogonal_(module.weight, gain)
                assert module.bias is not None
                nn.init.zeros_(module.bias)
    return network
