"""The same validation episodes for whichever weights a training has reached."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

from lndrl.config import RunConfig
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.evaluation.runner import BLOCK
from lndrl.machine.threads import kept_threads, set_threads
from lndrl.navigation.episode import OUTCOMES
from lndrl.navigation.families import Family
from lndrl.planners import PlannerSource
from lndrl.planners.policy import PolicyPlanner
from lndrl.policy import load_engine

SEED = 0
"""Of the episodes, whatever the run's seed is: runs can be compared episode by episode."""
FIRST = 500_000_000
"""The first episode's number. ``lndrl evaluate`` begins at 0, so what was chosen by these is judged
by others."""


class ValidationEpisodes:
    """``episodes`` validation episodes in the scenario and world of ``config``.

    Built once for a run; the worlds are used again. Each call counts how the episodes end under
    other weights. Sampled actions are drawn from generators of the episodes, so the same weights
    give the same counts.
    """

    def __init__(self, config: RunConfig, episodes: int) -> None:
        self.episodes = episodes
        self._config = config.model_copy(update={"seed": SEED})
        self._runner: EpisodeRunner | None = None

    def __call__(
        self, weights: bytes, greedy: bool = False, stopped: Callable[[], bool] = bool
    ) -> dict[str, int] | None:
        """Counts by name: ``episodes``, the outcomes, and control ``steps``; None when stopped.

        Raises UserError for weights that do not fit the configuration and for an impossible
        scenario.
        """
        counts: Counter[str] = Counter()
        with _alone(self._config):
            runner = self._drive(weights, greedy)
            for first in range(0, self.episodes, BLOCK):
                block = range(first, min(first + BLOCK, self.episodes))
                for record in runner([FIRST + k for k in block]):
                    if stopped():
                        return None
                    counts["episodes"] += 1
                    counts[record.outcome] += 1
                    counts["steps"] += record.steps
        return {name: counts[name] for name in ("episodes", *OUTCOMES, "steps")}

    def _drive(self, weights: bytes, greedy: bool) -> EpisodeRunner:
        if self._runner is None:
            source = PlannerSource("validation", self._config, weights)
            self._runner = EpisodeRunner(source, self._config, family=Family.VALIDATION)
        planner = self._runner.planner
        assert isinstance(planner, PolicyPlanner)
        planner.renew(weights)
        planner.greedy = greedy
        return self._runner


@contextmanager
def _alone(config: RunConfig) -> Iterator[None]:
    """One thread, as in ``lndrl evaluate``, and no draw from torch's own generator.

    A learner in the same process finds both as they were.
    """
    load_engine(config)
    torch = sys.modules.get("torch")
    with kept_threads(), nullcontext() if torch is None else torch.random.fork_rng(devices=[]):
        set_threads(1)
        yield
