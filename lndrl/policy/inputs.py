"""What the networks read, made from observations: on the CPU sparse, elsewhere drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lndrl.config import RunConfig
from lndrl.navigation import Observation, dequantise
from lndrl.navigation.pedestrian_map import draw_pedestrian_map
from lndrl.policy.structure import LEVELS, STAND_IN, MapStructure, map_structure


@dataclass(frozen=True)
class Inputs:
    """What a network reads for N samples.

    scan: float32 (N, beams) in [0, 1]. goal: float32 (N, 6). people: the pedestrian maps, either
    dense float32 (N, 3, cells, cells) or as the structure of their non-empty parts.
    """

    scan: Tensor
    goal: Tensor
    people: Tensor | MapStructure


def prepare(observation: Observation, config: RunConfig, device: str = "cpu") -> Inputs:
    """Network inputs of observations with leading shape (N,); sparse where that is possible.

    Both networks can share the result, which holds no weights.
    """
    task = config.task
    range_max = config.world.laser.range_max
    scan = torch.from_numpy(dequantise(observation.scan, range_max))
    scan = scan.to(device).mul_(1.0 / range_max)
    goal = torch.from_numpy(np.array(observation.goal)).to(device)  # may be a read-only message
    people: Tensor | MapStructure
    if device == "cpu" and supports_sparse(config):
        people = map_structure(observation, task, pooling_factor(config))
    else:
        drawn = draw_pedestrian_map(observation.pedestrians, observation.pedestrian_count, task)
        people = torch.from_numpy(drawn).to(device, memory_format=torch.channels_last)
    return Inputs(scan, goal, people)


def supports_sparse(config: RunConfig) -> bool:
    """Whether the sparse encoder can evaluate this network."""
    cells, pooling = config.task.map_cells, pooling_factor(config)
    return cells >= STAND_IN[pooling] and cells % pooling**LEVELS == 0


def pooling_factor(config: RunConfig) -> int:
    """By how much each level of the map encoder shrinks a side: 2, or 1 without pooling."""
    return 2 if config.network.pooling == "max" else 1
