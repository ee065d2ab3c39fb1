"""Stable-Baselines3's PPO with these networks, on observations that cost it nothing.

What a training of ours does beside it, worlds, filter and network included, it need not do: its
environment hands out observations that were recorded before.
"""

from __future__ import annotations

from importlib import metadata
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium import spaces

from lndrl.bench.scene import hybrid_config, observations
from lndrl.config import RunConfig
from lndrl.navigation import draw_pedestrian_map
from lndrl.policy import Inputs, NavigationNetwork, build_policy, prepare

PEER = "stable-baselines3"
_ENVIRONMENTS, _STEPS, _POOL = 8, 64, 512


def measure_peers(seconds: float) -> dict[str, Any]:
    """``steps_per_second`` of PPO with 4 epochs and minibatches of 256, rollouts included.

    The second iteration of 512 steps is timed, on all cores, however long it takes; ``seconds``
    has no say. The networks are evaluated densely, as any library would.
    """
    try:
        from stable_baselines3 import PPO
    except ImportError:
        return {PEER: {"missing": f"pip install {PEER}"}}
    config = hybrid_config()
    pool = _pool(config)
    extractor = _extractor(config)
    model = PPO(
        "MultiInputPolicy",
        _environments(pool),
        n_steps=_STEPS,
        batch_size=256,
        n_epochs=4,
        seed=1,
        device="cpu",
        policy_kwargs={
            "features_extractor_class": extractor,
            "share_features_extractor": False,
            "net_arch": [],
        },
    )
    steps = _ENVIRONMENTS * _STEPS
    model.learn(steps)
    started = perf_counter()
    model.learn(steps)
    rate = steps / (perf_counter() - started)
    return {PEER: {"steps_per_second": rate, "version": metadata.version(PEER)}}


def _pool(config: RunConfig) -> dict[str, np.ndarray[Any, Any]]:
    met = observations(config, _POOL, 1)[0]
    maps = draw_pedestrian_map(met.pedestrians, met.pedestrian_count, config.task)
    inputs = prepare(met, config)
    return {"scan": inputs.scan.numpy(), "goal": inputs.goal.numpy(), "map": maps}


class _Recorded(gymnasium.Env[dict[str, Any], int]):
    """Hands out recorded observations in any order; episodes have 100 steps."""

    def __init__(self, pool: dict[str, np.ndarray[Any, Any]], seed: int) -> None:
        self._pool, self._steps = pool, 0
        self._generator = np.random.default_rng(seed)
        shapes = {name: rows.shape[1:] for name, rows in pool.items()}
        self.observation_space = spaces.Dict(
            {name: spaces.Box(-np.inf, np.inf, shape, np.float32) for name, shape in shapes.items()}
        )
        self.action_space: Any = spaces.Discrete(28)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        self._steps = 0
        return self._any(), {}

    def step(self, action: int) -> Any:
        self._steps += 1
        return self._any(), float(self._generator.normal()), False, self._steps >= 100, {}

    def _any(self) -> dict[str, Any]:
        row = self._generator.integers(_POOL)
        return {name: rows[row] for name, rows in self._pool.items()}


def _environments(pool: dict[str, np.ndarray[Any, Any]]) -> Any:
    from stable_baselines3.common.vec_env import DummyVecEnv

    def make(seed: int) -> Any:
        return lambda: _Recorded(pool, seed)

    return DummyVecEnv([make(seed) for seed in range(_ENVIRONMENTS)])


def _extractor(config: RunConfig) -> Any:
    """All of a network but its head, as Stable-Baselines3 takes it."""
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

    class Extractor(BaseFeaturesExtractor):
        def __init__(self, space: Any) -> None:
            super().__init__(space, config.network.features)
            network = build_policy(config)
            assert isinstance(network, NavigationNetwork)
            network.head = torch.nn.Identity()  # type: ignore[assignment]
            self.network = network

        def forward(self, seen: dict[str, torch.Tensor]) -> torch.Tensor:
            people = seen["map"].contiguous(memory_format=torch.channels_last)
            return self.network(Inputs(seen["scan"], seen["goal"], people))

    return Extractor
