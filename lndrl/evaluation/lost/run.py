"""Driving episodes of a planner in several scenarios, and watching how it gets lost."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.evaluation.lost.record import Recorder, Trace
from lndrl.evaluation.pool import Work, run_tasks
from lndrl.evaluation.runner import BLOCK
from lndrl.navigation.families import Family
from lndrl.planners import PlannerSource
from lndrl.policy import act_on_one_thread


@dataclass(frozen=True)
class Task:
    """One block of episodes in a scenario; ``place`` indexes the configurations."""

    place: int
    episodes: range


def trace_episodes(
    source: PlannerSource,
    configs: Sequence[RunConfig],
    episodes: int,
    workers: int = 0,
    greedy: bool = False,
    progress: Callable[[Trace], None] | None = None,
) -> list[Trace]:
    """Drive ``episodes`` validation episodes under each of ``configs``, one of each scenario.

    ``workers`` processes share the work, 0 keeps it in this one; the result is the same.
    ``progress`` gets each trace as its episode ends, in any order. Ctrl-C leaves no process.

    Raises UserError for perfect localization, for a planner that cannot be built, for an impossible
    scenario, and when a worker dies.
    """
    for config in configs:
        check_localization(config)
    tasks = [
        Task(place, range(first, min(first + BLOCK, episodes)))
        for place in range(len(configs))
        for first in range(0, episodes, BLOCK)
    ]
    found: list[tuple[int, Trace]] = []
    arguments = (source, tuple(configs), greedy)
    results = run_tasks(_make_work, arguments, tasks, min(workers, len(tasks)), configs[0])
    with closing(results):
        for place, trace in results:
            found.append((place, trace))
            if progress is not None:
                progress(trace)
    found.sort(key=lambda each: (each[0], each[1].episode))
    return [trace for _, trace in found]


def check_localization(config: RunConfig) -> None:
    """Raise UserError where there is nothing to find out."""
    if config.localization.kind == "perfect":
        raise UserError(
            "localization: kind is perfect, and nobody gets lost who is told the truth; "
            "ask about a planner whose filter is amcl"
        )


class _Watched:
    """A worker: keeps the runner of the scenario at hand, because tasks come one after another."""

    def __init__(self, source: PlannerSource, configs: tuple[RunConfig, ...], greedy: bool) -> None:
        self._source, self._configs, self._greedy = source, configs, greedy
        self._place = -1
        self._runner: EpisodeRunner | None = None

    def __call__(self, task: Task) -> Iterator[tuple[int, Trace]]:
        config = self._configs[task.place]
        if self._runner is None or task.place != self._place:
            self._runner = EpisodeRunner(self._source, config, self._greedy, Family.VALIDATION)
            self._place = task.place
        recorder = Recorder(task.episodes, config)
        for record in self._runner(task.episodes, recorder):
            yield task.place, recorder.trace(record)


def _make_work(source: PlannerSource, configs: tuple[RunConfig, ...], greedy: bool) -> Work:
    if source.weights is not None:
        act_on_one_thread(*configs)
    return _Watched(source, configs, greedy)
