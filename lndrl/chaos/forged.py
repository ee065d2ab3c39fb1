"""Uploads made by hand: valid arrays and messages without a world behind them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.navigation import Observation, Trajectory, final_indices
from lndrl.navigation.privileged.floats import LIMIT, NAMES
from lndrl.transport import ChunkHeader, Hello
from lndrl.version import VERSION


def forged_arrays(
    config: RunConfig,
    draw: np.random.Generator,
    worlds: int = 1,
    version: int = 0,
) -> dict[str, NDArray[Any]]:
    """A valid upload of ``worlds`` worlds, as long as the run's are, with contents at random.

    ``version``: the weights that it claims to have acted on.
    """
    shape = (config.actor.horizon, worlds)
    actions = len(config.task.linear_velocities) * len(config.task.angular_velocities)
    ends = draw.uniform(size=shape)
    terminated = (ends < 0.1).astype(np.uint8)
    truncated = ((ends > 0.1) & (ends < 0.2)).astype(np.uint8)
    index = final_indices(terminated, truncated)
    return Trajectory(
        observation=_observation(config, draw, shape),
        action=draw.integers(0, actions, shape).astype(np.uint8),
        log_prob=np.full(shape, -np.log(actions), np.float32),
        reward=draw.normal(size=shape).astype(np.float32),
        terminated=terminated,
        truncated=truncated,
        version=np.full(shape, version, np.uint32),
        final_index=index,
        final_observation=_observation(config, draw, (len(index),)),
        teacher=_labels(config, draw, (*shape, actions)),
        privileged=_privileged(config, draw, shape),
        final_privileged=_privileged(config, draw, (len(index),)),
    ).to_arrays()


def _observation(
    config: RunConfig, draw: np.random.Generator, shape: tuple[int, ...]
) -> Observation:
    """Scans, a goal, and one person in view."""
    observation = Observation.zeros_for(shape, config)
    observation.scan[:] = draw.integers(0, 65536, observation.scan.shape)
    observation.goal[..., :2] = draw.normal(scale=5.0, size=(*shape, 2))
    observation.pedestrian_count[:] = 1
    observation.pedestrians[..., 0, :] = draw.uniform(-0.5, 0.5, (*shape, 4))
    return observation


def _labels(
    config: RunConfig, draw: np.random.Generator, shape: tuple[int, ...]
) -> NDArray[np.float16] | None:
    """What a teacher would say, in a run that has one."""
    if config.ppo.teacher is None:
        return None
    return draw.uniform(0.0, 9.0, shape).astype(np.float16)


def _privileged(
    config: RunConfig, draw: np.random.Generator, shape: tuple[int, ...]
) -> NDArray[np.float32] | None:
    """What a critic would see, in a run whose critic sees more."""
    if not config.learner.privileged_critic:
        return None
    return draw.uniform(-LIMIT, LIMIT, (*shape, len(NAMES))).astype(np.float32)


def forged_hello(actor_id: str, life: str, worlds: int = 1) -> Hello:
    """What an actor of this version would say."""
    return Hello(actor_id, life, "chaos", 0, worlds, VERSION)


def forged_header(
    run_id: str, actor_id: str, life: str, sequence: int, steps: int, worlds: int = 1
) -> ChunkHeader:
    """The head of an upload of that many steps and worlds."""
    return ChunkHeader(run_id, actor_id, life, sequence, steps, worlds, host="chaos")
