"""Filling a results folder: every missing block of episodes, on all cores, in any order.

Blocks are as large as those of ``lndrl evaluate`` and always whole, the last one and one that was
interrupted as well: what a policy does depends, by rounding, on which episodes share its batch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass

from lndrl.config import RunConfig
from lndrl.evaluation.benchmark.spec import Contender, bench_config, bench_hash
from lndrl.evaluation.benchmark.store import Identity, ResultsFolder
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.evaluation.pool import Work, run_tasks
from lndrl.evaluation.runner import BLOCK
from lndrl.navigation import EpisodeRecord
from lndrl.version import VERSION


@dataclass(frozen=True)
class Task:
    """One block of episodes of a method in a scenario; ``cell`` indexes the plan's cells."""

    cell: int
    episodes: range


@dataclass(frozen=True)
class Cell:
    """A method in a scenario."""

    contender: Contender
    scenario: str
    config: RunConfig


class Plan:
    """What is to be tested, and what of it is not in ``folder`` yet.

    ``changes`` (scenario to key=value) make another bench of some scenarios, for calibration.

    Raises UserError for unknown scenarios; the other methods also where the folder holds results
    of another bench, seed or weights, or cannot be written.
    """

    def __init__(
        self,
        folder: ResultsFolder,
        methods: Sequence[Contender],
        scenarios: Sequence[str],
        episodes: int,
        seed: int,
        changes: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        self.folder, self.episodes = folder, episodes
        changes = changes or {}
        self.cells = [
            Cell(
                contender,
                scenario,
                bench_config(contender, scenario, seed, changes.get(scenario, ())),
            )
            for contender in methods
            for scenario in scenarios
        ]
        self.identity = Identity(
            seed,
            VERSION,
            {cell.scenario: bench_hash(cell.config) for cell in self.cells},
            {contender.name: describe(contender) for contender in methods},
            {scenario: list(changes[scenario]) for scenario in scenarios if scenario in changes},
        )

    def left(self) -> int:
        """Episodes that ``run`` will run; takes the folder for this plan."""
        return sum(len(task.episodes) for task in self.missing())

    def missing(self) -> list[Task]:
        """Blocks that are not whole; the episodes of those that are cut are cleared away."""
        self.folder.claim(self.identity)
        tasks = []
        for number, cell in enumerate(self.cells):
            kept = self.folder.records(cell.contender.name, cell.scenario)
            known = max(kept, default=-1) + 1
            whole: list[EpisodeRecord] = []
            for first in range(0, max(known, self.episodes), BLOCK):
                block = range(first, first + BLOCK)
                if all(k in kept for k in block):
                    whole += [kept[k] for k in block]
                elif first < self.episodes:
                    tasks.append(Task(number, block))
            self.folder.keep(cell.contender.name, cell.scenario, whole)
        return tasks

    def run(
        self, workers: int, progress: Callable[[Cell, EpisodeRecord], None] | None = None
    ) -> None:
        """Test what is missing; ``workers`` processes share it, 0 keeps it in this one.

        Raises UserError when a worker dies. Whatever has ended is kept; Ctrl-C leaves no process.
        """
        tasks = self.missing()
        results = run_tasks(_make_work, (tuple(self.cells),), tasks, min(workers, len(tasks)))
        with closing(results):
            for number, record in results:
                cell = self.cells[number]
                self.folder.add(cell.contender.name, cell.scenario, record)
                if progress is not None:
                    progress(cell, record)
        self.missing()  # the order of a file's rows then does not tell who was faster


def describe(contender: Contender) -> dict[str, str]:
    """What a method was, for ``benchmark.json``."""
    return {
        "planner": contender.source.name,
        "identity": contender.identity,
        "actions": contender.actions,
        "localization": contender.localization,
    }


class _Bench:
    """A worker: keeps the runner of the cell at hand, because tasks come cell by cell."""

    def __init__(self, cells: tuple[Cell, ...]) -> None:
        self._cells = cells
        self._number = -1
        self._runner: EpisodeRunner | None = None

    def __call__(self, task: Task) -> Iterable[tuple[int, EpisodeRecord]]:
        if self._runner is None or task.cell != self._number:
            cell = self._cells[task.cell]
            self._runner = EpisodeRunner(cell.contender.source, cell.config, cell.contender.greedy)
            self._number = task.cell
        for record in self._runner(task.episodes):
            yield task.cell, record


def _make_work(cells: tuple[Cell, ...]) -> Work:
    if any(cell.contender.source.weights is not None for cell in cells):
        import torch

        # Workers share the cores by being many, and sums rounded alike need as many threads.
        torch.set_num_threads(1)
    return _Bench(cells)
