"""Driving the same episodes of the bench with several methods, for where they went."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.evaluation.behaviour.course import Course, Watcher
from lndrl.evaluation.benchmark import Contender
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.evaluation.pool import Work, run_tasks
from lndrl.evaluation.runner import BLOCK
from lndrl.navigation.families import Family
from lndrl.policy import act_on_one_thread


@dataclass(frozen=True)
class Drives:
    """What one method drives: ``config`` is the bench's for it."""

    contender: Contender
    config: RunConfig


def drive_courses(
    drives: Sequence[Drives],
    episodes: int,
    workers: int = 0,
    progress: Callable[[Course], None] | None = None,
) -> list[list[Course]]:
    """Drive the bench's episodes 0 to ``episodes`` - 1 with each of ``drives``; courses in order.

    A policy's are those of ``lndrl benchmark`` to the bit: it drives whole blocks. ``workers``
    processes share the work, 0 keeps it in this one; the result is the same. ``progress`` gets
    each course as it ends, in any order. Ctrl-C leaves no process.

    Raises UserError for a planner that cannot be built and when a worker dies.
    """
    tasks = [
        (number, range(first, first + BLOCK))
        for number in range(len(drives))
        for first in range(0, episodes, BLOCK)
    ]
    found: list[list[Course]] = [[] for _ in drives]
    config = drives[0].config
    results = run_tasks(_make_work, (tuple(drives),), tasks, min(workers, len(tasks)), config)
    with closing(results):
        for number, course in results:
            if course.episode >= episodes:
                continue  # of the last block, to be whole
            found[number].append(course)
            if progress is not None:
                progress(course)
    return [sorted(courses, key=lambda course: course.episode) for courses in found]


def check_map(config: RunConfig) -> None:
    """Raise UserError where episodes have no map in common to be compared on."""
    if config.scenario.layouts is not None:
        raise UserError(
            f"scenario {config.scenario.name} has many layouts and no map to compare on; name one "
            "with a single place, e.g. hall"
        )


class _Driving:
    """A worker: keeps the runner of the method at hand, because tasks come method by method."""

    def __init__(self, drives: tuple[Drives, ...]) -> None:
        self._drives = drives
        self._number = -1
        self._runner: EpisodeRunner | None = None

    def __call__(self, task: tuple[int, range]) -> Iterator[tuple[int, Course]]:
        number, episodes = task
        contender, config = self._drives[number].contender, self._drives[number].config
        if self._runner is None or number != self._number:
            self._runner = EpisodeRunner(contender.source, config, contender.greedy, Family.BENCH)
            self._number = number
        watcher = Watcher(config.world.tick * config.world.ticks_per_step)
        for record in self._runner(episodes, watcher):
            yield number, watcher.course(record)


def _make_work(drives: tuple[Drives, ...]) -> Work:
    policies = [each.config for each in drives if each.contender.source.weights is not None]
    if policies:
        act_on_one_thread(*policies)
    return _Driving(drives)
