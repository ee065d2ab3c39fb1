"""What the networks read, as tensors: on the CPU sparse, elsewhere drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lndrl.config import RunConfig
from lndrl.navigation import Observation
from lndrl.policy.arrays import ArrayInputs, array_inputs
from lndrl.policy.sparse import MapStructure


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
    return as_tensors(array_inputs(observation, config, exact), privileged)


def as_tensors(arrays: ArrayInputs, privileged: NDArray[np.float32] | None = None) -> Inputs:
    """The same inputs as tensors, of the same memory."""
    people: Tensor | MapStructure | None
    if isinstance(arrays.people, np.ndarray):
        people = torch.from_numpy(arrays.people).contiguous(memory_format=torch.channels_last)
    else:
        people = arrays.people
    known = None if privileged is None else torch.from_numpy(privileged)
    return Inputs(torch.from_numpy(arrays.scan), torch.from_numpy(arrays.goal), people, known)
