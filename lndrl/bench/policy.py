"""``lndrl bench policy``: acting on one core, on observations of the hybrid scenario."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from lndrl.bench.report import median_seconds
from lndrl.bench.scene import WORLDS, hybrid_config, observations
from lndrl.policy import PolicyRunner

BATCHES = (WORLDS, 32)
_VARIETY = 16


def measure(seconds: float) -> dict[str, Any]:
    """``samples_per_second`` of ``PolicyRunner.act`` with the worlds of one actor as its batch.

    ``by_batch`` has other batch sizes, too. One torch thread, as in actors; a sample is one
    observation, drawing of the pedestrian map and sampling of the action included.
    """
    config = hybrid_config()
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        runner = PolicyRunner(config)
        rates = {str(batch): _rate(runner, batch, seconds) for batch in BATCHES}
    finally:
        torch.set_num_threads(threads)
    return {"samples_per_second": rates[str(WORLDS)], "by_batch": rates}


def _rate(runner: PolicyRunner, batch: int, seconds: float) -> float:
    seen = observations(runner.config, batch, _VARIETY)
    generator = np.random.default_rng(0)

    def act_on_all() -> None:
        # Different observations one after the other: how many people are in view matters.
        for observation in seen:
            runner.act(observation, generator)

    return _VARIETY * batch / median_seconds(act_on_all, seconds)
