"""A small room with people, and policies to export that have an opinion."""

from __future__ import annotations

from typing import Any

import torch

from lndrl.config import RunConfig
from lndrl.policy import build_policy, policy_metadata, to_bytes
from lndrl.policy.networks import NavigationNetwork

ROOM = {
    "name": "room",
    "size": [9, 6],
    "pedestrians": {
        "count": [4, 4],
        "routes": [{"start": [1, 1, 7, 2], "goal": [1, 4, 7, 5]}],
    },
    "robot": [{"start": [1, 1, 2, 5], "goal": [7, 1, 8, 5]}],
}
FEW = 40
"""Observations that are enough to compare on."""

SMALL = {"map_channels": [8, 8, 8], "features": 32, "goal_features": 8}


def made_config(task: Any = None, **network: Any) -> RunConfig:
    return RunConfig.model_validate(
        {
            "scenario": ROOM,
            "localization": {"min_particles": 50, "max_particles": 60, "delay": 1},
            "task": task or {},
            "network": {**SMALL, **network},
        }
    )


def weights_of(config: RunConfig, seed: int = 0, gain: float = 100.0) -> bytes:
    """First weights, the built-in head ``gain`` times as large: probabilities differ then."""
    torch.manual_seed(seed)
    network = build_policy(config)
    if isinstance(network, NavigationNetwork):
        with torch.no_grad():
            network.head.weight.mul_(gain)
    return to_bytes(network, policy_metadata(config, 7, 1234))
