"""What benchmarks measure on: the hybrid scenario under the default configuration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from lndrl.config import REPOSITORY_CONFIGS, RunConfig, load_config
from lndrl.navigation import Observation, VectorNavigation, action_table

WORLDS = 8


SCENARIOS = ("hybrid", "sparse", "corridor", "hall", "irregular")
"""The paper's five."""


_settings: list[str] = []


@contextmanager
def with_settings(settings: Sequence[str]) -> Iterator[None]:
    """Measure under ``settings`` (key=value) while this lasts, whatever a benchmark changes."""
    _settings.extend(settings)
    try:
        yield
    finally:
        _settings.clear()


def settings() -> list[str]:
    """What ``with_settings`` has asked for."""
    return list(_settings)


def hybrid_config(overrides: Sequence[str] = ()) -> RunConfig:
    """``configs/lndrl.yaml`` on the hybrid scenario, but for ``overrides`` (key=value)."""
    fixed = ["scenario=hybrid", "seed=1"]
    return load_config(REPOSITORY_CONFIGS / "lndrl.yaml", [*fixed, *_settings, *overrides])


class RandomActions:
    """Uniform action indices uint8 (worlds,) with every call, the same in every run."""

    def __init__(self, config: RunConfig, worlds: int) -> None:
        self._generator = np.random.default_rng(0)
        self._count = len(action_table(config.task))
        self._worlds = worlds

    def __call__(self) -> NDArray[np.uint8]:
        return self._generator.integers(self._count, size=self._worlds).astype(np.uint8)


def observations(config: RunConfig, batch: int, batches: int) -> list[Observation]:
    """``batches`` observations (batch,) met by randomly driven worlds, ten steps apart."""
    environment = VectorNavigation(config, 0, WORLDS)
    actions = RandomActions(config, WORLDS)
    rows: list[Observation] = []
    while len(rows) * WORLDS < batch * batches:
        for _ in range(10):
            environment.step(actions())
        rows.append(environment.observation.copy())
    joined = Observation.concatenate(rows)
    return [joined.take(np.s_[i * batch : (i + 1) * batch]) for i in range(batches)]
