"""Small real runs for the learner's tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig, parse_config
from lndrl.navigation import Observation, Trajectory
from lndrl.navigation.privileged.floats import NAMES
from lndrl.navigation.trajectory import final_indices


def small_config(**changes: Any) -> RunConfig:
    """A tiny network and batch; ``changes`` by section, e.g. ``ppo={"epochs": 2}``."""
    data: dict[str, Any] = {
        "scenario": {
            "name": "room",
            "size": [10, 10],
            "pedestrians": {
                "count": [2, 3],
                "routes": [{"start": [1, 4, 2, 5], "goal": [8, 4, 9, 5]}],
            },
            "robot": [{"start": [1, 1, 2, 2], "goal": [7, 7, 9, 9]}],
        },
        "network": {"map_channels": [4, 4, 8], "features": 16, "goal_features": 8},
        "ppo": {"batch_size": 32, "minibatch_size": 16, "epochs": 2},
        "learner": {"total_steps": 10_000, "threads": 2, "keep_checkpoints": 2},
        "actor": {"count": 2, "worlds": 2, "horizon": 8},
        "localization": {"min_particles": 100, "max_particles": 200},
    }
    for section, values in changes.items():
        data[section] = {**data.get(section, {}), **values} if isinstance(values, dict) else values
    return parse_config(data, "small configuration")


def random_trajectory(
    config: RunConfig, seed: int, steps: int = 8, worlds: int = 2, version: int = 0
) -> Trajectory:
    """A valid trajectory with random contents."""
    rng = np.random.default_rng(seed)
    shape = (steps, worlds)
    observation = random_observations(config, rng, shape)
    ends = rng.uniform(size=shape)
    terminated = (ends < 0.1).astype(np.uint8)
    truncated = ((ends > 0.1) & (ends < 0.2)).astype(np.uint8)
    index = final_indices(terminated, truncated)
    return Trajectory(
        observation=observation,
        action=rng.integers(0, 28, shape).astype(np.uint8),
        log_prob=np.full(shape, -np.log(28.0), np.float32),
        reward=rng.normal(scale=100.0, size=shape).astype(np.float32),
        terminated=terminated,
        truncated=truncated,
        version=np.full(shape, version, np.uint32),
        final_index=index,
        final_observation=random_observations(config, rng, (len(index),)),
        teacher=random_costs(rng, shape) if config.ppo.teacher else None,
        privileged=random_privileged(config, rng, shape),
        final_privileged=random_privileged(config, rng, (len(index),)),
    )


def random_costs(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float16]:
    """What a teacher might say: one of 28 actions is the cheapest."""
    costs = rng.uniform(0.0, 5.0, (*shape, 28))
    above: NDArray[np.float16] = (costs - costs.min(axis=-1, keepdims=True)).astype(np.float16)
    return above


def random_privileged(
    config: RunConfig, rng: np.random.Generator, shape: tuple[int, ...]
) -> np.ndarray | None:
    """What a privileged critic sees, where the run has one."""
    if not config.learner.privileged_critic:
        return None
    return rng.uniform(-3.0, 3.0, (*shape, len(NAMES))).astype(np.float32)


def random_observations(
    config: RunConfig, rng: np.random.Generator, shape: tuple[int, ...]
) -> Observation:
    """Scans, goals and one person each."""
    observation = Observation.zeros_for(shape, config)
    observation.scan[:] = rng.integers(0, 65536, observation.scan.shape)
    observation.goal[..., :2] = rng.normal(scale=5.0, size=(*shape, 2))
    observation.pedestrian_count[:] = 1
    observation.pedestrians[..., 0, :] = rng.uniform(-0.5, 0.5, (*shape, 4))
    return observation
