"""Checkpoints of before a value network saw privileged floats, as that network takes them.

What it has learned stays: the encoder of the floats is new, and the trunk does not listen to it
yet, so the first values are those of before.
"""

from __future__ import annotations

import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor

from lndrl.errors import UserError
from lndrl.policy import NavigationNetwork, Network

_ENCODER = "privileged_encoder."
_TRUNK = "trunk.weight"  # its last columns read the encoder


def widened_value(blob: bytes, network: Network, where: str) -> bytes:
    """Weights of a value network for ``network``, which may see privileged floats as they do not.

    Unchanged where both or neither do. Raises UserError where only the weights' network did.
    """
    if not isinstance(network, NavigationNetwork):
        return blob
    try:
        tensors = load_tensors(blob)
    except (SafetensorError, ValueError, KeyError, TypeError):
        return blob  # whoever loads it says what is wrong
    saw = any(name.startswith(_ENCODER) for name in tensors)
    if network.privileged_encoder is None and saw:
        raise UserError(
            f"{where}: its value network saw privileged floats, and this run's does not; set "
            "learner.privileged_critic: true"
        )
    if network.privileged_encoder is None or saw or _TRUNK not in tensors:
        return blob
    fresh = {k: v.cpu() for k, v in network.state_dict().items() if k.startswith(_ENCODER)}
    tensors[_TRUNK] = _wider(tensors[_TRUNK], network)
    return save_tensors({**tensors, **fresh})


def widened_moments(tensors: dict[str, Tensor], network: Network) -> dict[str, Tensor]:
    """Adam's moments for ``network`` as of ``widened_value``: none yet for what is new."""
    if not isinstance(network, NavigationNetwork) or network.privileged_encoder is None:
        return tensors
    if any(name.startswith(f"value/{_ENCODER}") for name in tensors):
        return tensors
    names = [f"value/{_TRUNK}/{moment}" for moment in ("exp_avg", "exp_avg_sq")]
    return tensors | {name: _wider(tensors[name], network) for name in names if name in tensors}


def _wider(matrix: Tensor, network: NavigationNetwork) -> Tensor:
    """``matrix`` (outputs, inputs) with columns of zeros for the encoder's features."""
    assert network.privileged_encoder is not None
    if matrix.ndim != 2:
        return matrix
    return torch.cat(
        (matrix, matrix.new_zeros(len(matrix), network.privileged_encoder.out_features)), dim=1
    )
