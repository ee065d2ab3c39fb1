"""What the networks read, made from observations: on the CPU sparse, elsewhere drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lndrl.config import RunConfig
from lndrl.config.learning import BUILT_IN
from lndrl.navigation import Observation
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.navigation.pedestrian_map import draw_pedestrian_map
from lndrl.policy.sparse import LEVELS, STAND_IN, MapStructure, map_structure


@dataclass(frozen=True)
class Inputs:
    """What a network reads for N samples.

    scan: float32 (N, scan_frames * beams) in [0, 1]. goal: float32 (N, 6). people: the pedestrian
    maps, either dense float32 (N, 3, cells, cells) or as the structure of their non-empty parts;
    None for a network that reads none. privileged: float32 (N, K) for the value network alone, see
    ``lndrl.navigation.privileged``; None where nobody knows them, as in all acting.
    """

    scan: Tensor
    goal: Tensor
    people: Tensor | MapStructure | None
    privileged: Tensor | None = None


def prepare(
    observation: Observation,
    config: RunConfig,
    privileged: NDArray[np.float32] | None = None,
    exact: bool = True,
) -> Inputs:
    """Network inputs on the CPU of observations (N,); sparse where that is possible.

    ``privileged`` (N, K) is what the value network also sees, where the run has it; ``exact``: for
    products in float32.
    Both networks can share the result, which holds no weights. Other devices make their inputs
    themselves, from a CompactObservation.
    """
    scan = torch.from_numpy(observation.scan * np.float32(1.0 / SCAN_COUNTS))
    goal = torch.from_numpy(np.array(observation.goal))  # may be a read-only message
    people: Tensor | MapStructure | None
    if not config.network.pedestrian_map:
        people = None
    elif supports_sparse(config):
        people = map_structure(observation, config.task, pooling_factor(config), exact)
    else:
        people = torch.from_numpy(
            draw_pedestrian_map(observation.pedestrians, observation.pedestrian_count, config.task)
        ).contiguous(memory_format=torch.channels_last)
    known = None if privileged is None else torch.from_numpy(privileged)
    return Inputs(scan, goal, people, known)


def supports_sparse(config: RunConfig) -> bool:
    """Whether the sparse encoder can evaluate this network; a user's own gets dense maps."""
    network = config.network
    if network.policy != BUILT_IN or network.map_encoder != BUILT_IN:
        return False
    cells, pooling = config.task.map_cells, pooling_factor(config)
    return cells >= STAND_IN[pooling] and cells % pooling**LEVELS == 0


def pooling_factor(config: RunConfig) -> int:
    """By how much each level of the map encoder shrinks a side: 2, or 1 without pooling."""
    return 2 if config.network.pooling == "max" else 1
