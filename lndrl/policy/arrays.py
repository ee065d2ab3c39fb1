"""What the networks read, as arrays, made from observations without torch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.config.learning import BUILT_IN
from lndrl.navigation import Observation
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.navigation.pedestrian_map import draw_pedestrian_map
from lndrl.policy.sparse import LEVELS, STAND_IN, MapStructure, map_structure


@dataclass(frozen=True)
class ArrayInputs:
    """What a policy reads for N samples.

    scan: float32 (N, scan_frames * beams) in [0, 1]. goal: float32 (N, 6). people: the pedestrian
    maps, either as the structure of their non-empty parts or drawn, float32 (N, 3, cells, cells);
    None for a network that reads none.
    """

    scan: NDArray[np.float32]
    goal: NDArray[np.float32]
    people: MapStructure | NDArray[np.float32] | None


def array_inputs(observation: Observation, config: RunConfig, exact: bool = True) -> ArrayInputs:
    """Of observations (N,), sparse where that is possible; ``exact``: for products in float32.

    Holds no weights, and nothing of ``observation``'s memory, which may be a read-only message.
    """
    scan = observation.scan * np.float32(1.0 / SCAN_COUNTS)
    goal = np.array(observation.goal)
    people: MapStructure | NDArray[np.float32] | None
    if not config.network.pedestrian_map:
        people = None
    elif supports_sparse(config):
        people = map_structure(observation, config.task, pooling_factor(config), exact)
    else:
        people = draw_pedestrian_map(
            observation.pedestrians, observation.pedestrian_count, config.task
        )
    return ArrayInputs(scan, goal, people)


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
