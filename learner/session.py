"""What a learner has done since it started: counts that never go back, as monitors want them.

A run's own counters go back to a checkpoint when it is resumed; a rate that is made of them would
then be wrong.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.navigation import EpisodeRecord
from lndrl.navigation.episode import OUTCOMES
from lndrl.transport.status import MOST_LAG


class Session:
    """Written by the learner's thread alone; others may read at any time."""

    def __init__(self) -> None:
        self.started = time.time()
        self.steps = self.updates = self.lag_sum = 0
        self.lags = [0] * (MOST_LAG + 1)
        self.episodes = dict.fromkeys(OUTCOMES, 0)

    def learned(self, lag: NDArray[np.integer[Any]]) -> list[float]:
        """Count an update on samples of these lags (versions); returns their shares by lag."""
        counts = np.bincount(np.minimum(lag.ravel(), MOST_LAG).astype(np.int64))
        self.lags = [
            known + (int(counts[i]) if i < len(counts) else 0) for i, known in enumerate(self.lags)
        ]
        self.lag_sum += int(lag.sum())
        self.steps += lag.size
        self.updates += 1
        shares: list[float] = (counts / counts.sum()).tolist()
        return shares

    def ended(self, episodes: Iterable[EpisodeRecord]) -> None:
        """Count finished episodes by how they ended."""
        for episode in episodes:
            self.episodes[episode.outcome] += 1

    def figures(self) -> dict[str, Any]:
        """See ``lndrl.transport.status.Session``; plain data."""
        return {
            "started": max(0.0, self.started),
            "steps": self.steps,
            "updates": self.updates,
            "episodes": dict(self.episodes),
            "lags": list(self.lags),
            "lag_sum": self.lag_sum,
        }
