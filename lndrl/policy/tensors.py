"""Weights between torch's modules and bytes."""

from __future__ import annotations

import numpy as np
import torch
from safetensors.torch import save as save_tensors
from torch import nn

from lndrl.config import RunConfig
from lndrl.policy.networks import build_policy
from lndrl.policy.weights import read_tensors


def to_bytes(network: nn.Module, metadata: dict[str, str] | None = None) -> bytes:
    """All parameters of ``network`` as one safetensors blob (float32, on the CPU)."""
    tensors = {
        name: tensor.detach().to("cpu", torch.float32).contiguous()
        for name, tensor in network.state_dict().items()
    }
    return save_tensors(tensors, metadata)


def load_into(
    network: nn.Module, blob: bytes, where: str = "weights", config: RunConfig | None = None
) -> None:
    """Copy the tensors of ``blob`` into ``network``; raises UserError as ``read_tensors`` does."""
    expected = network.state_dict()
    shapes = {name: tuple(tensor.shape) for name, tensor in expected.items()}
    tensors = read_tensors(blob, shapes, where, config)
    with torch.no_grad():
        for name, target in expected.items():
            target.copy_(torch.from_numpy(np.array(tensors[name])))  # views are read-only


def initial_weights(config: RunConfig) -> bytes:
    """Freshly initialized policy weights, seeded by ``config.seed``."""
    torch.manual_seed(config.seed)
    return to_bytes(build_policy(config))
