"""Filling a results folder: every missing episode, on all cores, in any order.

A rule does the same whatever runs beside it: only what is missing is run, and each episode is
written when it ends. What a policy does depends, by rounding, on which episodes share its batch:
its blocks are those of ``lndrl evaluate``, always whole, the last one too, and each is written when
all of it has ended. So nothing that was written is ever run again; of a policy, what had ended in
the blocks at hand was not written yet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass

from lndrl.config import RunConfig
from lndrl.evaluation.benchmark.spec import Contender, bench_config, bench_hash
from lndrl.evaluation.benchmark.store import Identity, ResultsFolder
from lndrl.evaluation.episodes import EpisodeRunner, Surroundings
from lndrl.evaluation.pool import Work, run_tasks
from lndrl.evaluation.runner import BLOCK
from lndrl.navigation import EpisodeRecord, build_surroundings
from lndrl.navigation.families import Family
from lndrl.planners.factory import RULES
from lndrl.policy import act_on_one_thread
from lndrl.version import VERSION

_PLACES = 8
"""Places that a worker keeps: the bench's five and some more, some megabytes each."""


@dataclass(frozen=True)
class Task:
    """Episodes to run side by side in one cell; ``cell`` indexes the plan's cells."""

    cell: int
    episodes: tuple[int, ...]


@dataclass(frozen=True)
class Cell:
    """A method in a scenario."""

    contender: Contender
    scenario: str
    config: RunConfig
    family: Family = Family.BENCH

    @property
    def depends_on_company(self) -> bool:
        """Whether an episode can go otherwise beside others."""
        return self.contender.source.weights is not None


class Plan:
    """What is to be tested, and what of it is not in ``folder`` yet.

    ``changes`` (scenario to key=value) make another bench of some scenarios, for calibration;
    ``family`` says whose episodes are run, ``version`` of which version of the bench.

    Raises UserError for unknown scenarios and rules that refuse their world; the other methods
    also where the folder holds results of another bench, seed or weights, or cannot be written.
    """

    def __init__(
        self,
        folder: ResultsFolder,
        methods: Sequence[Contender],
        scenarios: Sequence[str],
        episodes: int,
        seed: int,
        changes: Mapping[str, Sequence[str]] | None = None,
        family: Family = Family.BENCH,
        version: int = 1,
    ) -> None:
        self.folder, self.episodes = folder, episodes
        changes = changes or {}
        self.cells = [
            Cell(
                contender,
                scenario,
                bench_config(contender, scenario, seed, changes.get(scenario, ())),
                family,
            )
            for contender in methods
            for scenario in scenarios
        ]
        for cell in self.cells:
            if cell.contender.source.name in RULES:  # quickly built; said now, not after hours
                cell.contender.source.build(cell.config)
        self.identity = Identity(
            seed,
            VERSION,
            {cell.scenario: bench_hash(cell.config) for cell in self.cells},
            {contender.name: describe(contender) for contender in methods},
            {scenario: list(changes[scenario]) for scenario in scenarios if scenario in changes},
            family.value,
            version,
        )

    def left(self) -> int:
        """Episodes that ``run`` will run; takes the folder for this plan."""
        return sum(len(task.episodes) for task in self.missing())

    def missing(self) -> list[Task]:
        """What has not been written yet, in blocks; puts what has in order."""
        self.folder.claim(self.identity)
        blocks = -(-self.episodes // BLOCK)
        tasks = []
        for number, cell in enumerate(self.cells):
            kept = self.folder.records(cell.contender.name, cell.scenario)
            if cell.depends_on_company:
                kept = _whole_blocks(kept)
            wanted = [k for k in range(blocks * BLOCK) if k not in kept]
            firsts = range(0, len(wanted), BLOCK)
            tasks += [Task(number, tuple(wanted[f : f + BLOCK])) for f in firsts]
            self.folder.keep(cell.contender.name, cell.scenario, kept.values())
        return tasks

    def run(
        self, workers: int, progress: Callable[[Cell, EpisodeRecord], None] | None = None
    ) -> None:
        """Test what is missing; ``workers`` processes share it, 0 keeps it in this one.

        ``progress`` hears of every episode when it has been written. Raises UserError when a
        worker dies. Whatever has been written is kept; Ctrl-C leaves no process.
        """
        run_plans([self], workers, progress)


def run_plans(
    plans: Sequence[Plan],
    workers: int,
    progress: Callable[[Cell, EpisodeRecord], None] | None = None,
) -> None:
    """``Plan.run`` of several plans by the same workers, one plan after the other."""
    cells = [(plan, cell) for plan in plans for cell in plan.cells]
    tasks: list[Task] = []
    first = 0
    for plan in plans:
        tasks += [Task(first + task.cell, task.episodes) for task in plan.missing()]
        first += len(plan.cells)
    work = (tuple(cell for _, cell in cells),)
    first_config = cells[0][1].config if cells else None
    results = run_tasks(_make_work, work, tasks, min(workers, len(tasks)), first_config)
    with closing(results):
        for number, records in results:
            plan, cell = cells[number]
            plan.folder.add(cell.contender.name, cell.scenario, *records)
            if progress is not None:
                for record in records:
                    progress(cell, record)
    for plan in plans:
        plan.missing()  # the order of a file's rows then does not tell who was faster


def _whole_blocks(records: Mapping[int, EpisodeRecord]) -> dict[int, EpisodeRecord]:
    """Those of blocks that are whole. Others are of a write that was cut off, or of a program that
    wrote each episode alone."""
    firsts = {k - k % BLOCK for k in records}
    whole = [f for f in firsts if all(k in records for k in range(f, f + BLOCK))]
    return {k: records[k] for f in whole for k in range(f, f + BLOCK)}


def describe(contender: Contender) -> dict[str, str]:
    """What a method was, for ``benchmark.json``."""
    return {
        "planner": contender.source.name,
        "identity": contender.identity,
        "actions": contender.actions,
        "localization": contender.localization,
    }


class _Bench:
    """A worker: keeps the runner of the cell at hand, because tasks come cell by cell, and the
    places that it has built last, because the next method is tested there, too."""

    def __init__(self, cells: tuple[Cell, ...]) -> None:
        self._cells = cells
        self._number = -1
        self._runner: EpisodeRunner | None = None
        self._places: dict[tuple[str, str], Surroundings] = {}

    def __call__(self, task: Task) -> Iterator[tuple[int, tuple[EpisodeRecord, ...]]]:
        cell = self._cells[task.cell]
        if self._runner is None or task.cell != self._number:
            self._runner = EpisodeRunner(
                cell.contender.source,
                cell.config,
                cell.contender.greedy,
                cell.family,
                self._surroundings(cell),
            )
            self._number = task.cell
        records: Iterable[EpisodeRecord] = self._runner(task.episodes)
        if cell.depends_on_company:
            yield task.cell, tuple(records)
            return
        for record in records:
            yield task.cell, (record,)

    def _surroundings(self, cell: Cell) -> Surroundings:
        # One bench hash, one world: whoever is tested there hears and touches the same.
        key = cell.scenario, bench_hash(cell.config)
        if key not in self._places:
            while len(self._places) >= _PLACES:
                del self._places[next(iter(self._places))]
            self._places[key] = build_surroundings(cell.config)
        return self._places[key]


def _make_work(cells: tuple[Cell, ...]) -> Work:
    act_on_one_thread(*(cell.config for cell in cells if cell.depends_on_company))
    return _Bench(cells)
