"""What ``test_team.py`` and its other rank train on, alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from learner.ppo.batch import Batch, assemble
from lndrl.config import RunConfig
from tests.learner.helpers_learner import random_trajectory, small_config

CASES: dict[str, dict[str, Any]] = {
    "several minibatches": {},
    "one minibatch": {"ppo": {"minibatch_size": None}},
    "one norm": {"ppo": {"joint_gradient_norm": True}},
    "fewer rows than ranks": {"ppo": {"minibatch_size": 1, "epochs": 1}, "steps": 4},
    "example": {"ppo": {"teacher": "predictive"}},
    "early stop": {"ppo": {"target_kl": 1e-9, "epochs": 4, "actor_learning_rate": 1e-2}},
    "diverges": {"rewards": np.inf},
}
"""Changes of the small configuration; ``steps`` of a chunk, a factor on ``rewards``."""
UPDATES = 2


def config_of(case: str) -> RunConfig:
    """Its configuration."""
    return small_config(**{k: v for k, v in CASES[case].items() if k in ("ppo", "network")})


def batches(case: str) -> list[Batch]:
    """Batches of three chunks, whose rows two ranks do not divide evenly."""
    config, found = config_of(case), []
    rewards, steps = CASES[case].get("rewards", 1.0), CASES[case].get("steps", 9)
    for update in range(UPDATES):
        chunks = [random_trajectory(config, 3 * update + n, steps, 3) for n in range(3)]
        found.append(assemble([replace(t, reward=t.reward * np.float32(rewards)) for t in chunks]))
    return found
