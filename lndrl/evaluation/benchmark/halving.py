"""Running the search for the bench's readings: rounds that drop the excluded, then judgement."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from lndrl.errors import UserError
from lndrl.evaluation.benchmark.calibration import (
    JUDGED,
    METHOD,
    CalibrationSpec,
    SearchSpec,
    dwa_of,
)
from lndrl.evaluation.benchmark.figures import Row, rows_of
from lndrl.evaluation.benchmark.run import Plan
from lndrl.evaluation.benchmark.search import Verdict, World, excluded_by, worlds_of
from lndrl.evaluation.benchmark.spec import BenchmarkSpec, Contender
from lndrl.evaluation.benchmark.store import ResultsFolder
from lndrl.navigation.families import Family
from lndrl.planners import behaviour_hash, planner_source


@dataclass
class Search:
    """The search of ``spec`` around ``bench``, kept in ``path``/WORLD and ``path``/judged/WORLD.

    Raises UserError where a planner does something else than when its hash was written down.
    """

    spec: CalibrationSpec
    bench: BenchmarkSpec
    path: Path
    dropped: dict[str, str] = field(default_factory=dict)
    """Worlds that are out, and why, by name."""

    def __post_init__(self) -> None:
        check_planners(self.search)
        self.worlds = worlds_of(self.search)

    @property
    def search(self) -> SearchSpec:
        """What is searched through; raises UserError where the file has none."""
        if self.spec.search is None:
            raise UserError("calibration: search is missing; name its factors there")
        return self.spec.search

    def round_plans(self, worlds: Sequence[World], episodes: int) -> list[Plan]:
        """DWA in each of ``worlds``."""
        seed = self.search.seed
        return [self._plan(w, [dwa_of(*w.readings)], episodes, seed, "") for w in worlds]

    def judge_plans(self, worlds: Sequence[World], methods: Sequence[str]) -> list[Plan]:
        """``methods`` on the episodes that no round saw."""
        seed, episodes = self.search.judge_seed, self.search.judged
        others = [
            Contender(name, planner_source(name), "amcl") for name in methods if name != METHOD
        ]
        return [
            self._plan(
                world,
                [*([dwa_of(*world.readings)] if METHOD in methods else []), *others],
                episodes,
                seed,
                JUDGED,
            )
            for world in worlds
        ]

    def _plan(
        self, world: World, who: list[Contender], episodes: int, seed: int, below: str
    ) -> Plan:
        changes = {s: [*self.bench.changes_in(s), *world.changes(s)] for s in self.spec.scenarios}
        folder = ResultsFolder(self.path / below / world.name)
        try:
            return Plan(
                folder, who, self.spec.scenarios, episodes, seed, changes, Family.CALIBRATION
            )
        except UserError as error:
            raise UserError(f"calibration: search: world {world.name}: {error}") from None

    def survivors(self, worlds: Sequence[World], episodes: int) -> list[World]:
        """Those of ``worlds`` that nothing excludes after ``episodes`` in each scenario."""
        left = []
        for world in worlds:
            (row,) = rows_of(ResultsFolder(self.path / world.name), [METHOD], None, episodes)
            columns = excluded_by(row)
            if columns:
                self.dropped[world.name] = f"{episodes}: {', '.join(columns)}"
            else:
                left.append(world)
        return left

    def run(self, drive: Callable[[str, list[Plan]], None]) -> list[Verdict]:
        """All rounds, then judgement: DWA in what is left, the others where (a) is met.

        ``drive`` is told in words what comes and runs the plans, e.g. by ``run_plans``.
        """
        left: Sequence[World] = self.worlds
        for episodes in self.search.rounds:
            drive(f"{len(left)} worlds, {episodes} episodes", self.round_plans(left, episodes))
            left = self.survivors(left, episodes)
        drive(f"{len(left)} worlds judged", self.judge_plans(left, [METHOD]))
        met = [verdict.world for verdict in self.verdicts(left) if not verdict.missed]
        if met:
            others = list(self.search.planners)
            drive(f"{len(met)} worlds that meet DWA's row", self.judge_plans(met, others))
        return self.verdicts(left)

    def verdicts(self, worlds: Sequence[World] | None = None) -> list[Verdict]:
        """Of all ``worlds`` that have been judged, the best first."""
        found = []
        for world in self.worlds if worlds is None else worlds:
            rows = self._judged_rows(world)
            if METHOD in rows:
                found.append(Verdict(world, rows))
        return sorted(found, key=Verdict.order)

    def _judged_rows(self, world: World) -> Mapping[str, Row]:
        folder = ResultsFolder(self.path / JUDGED / world.name)
        try:
            rows = rows_of(folder, None, None, self.search.judged)
        except UserError:
            return {}
        whole = self.search.judged * len(self.spec.scenarios)
        return {row.method: row for row in rows if len(row.records) == whole}


def check_planners(spec: SearchSpec) -> None:
    """Raises UserError unless every planner does what it did when its hash was written down."""
    for name, frozen in spec.planners.items():
        try:
            found = behaviour_hash(name)
        except UserError as error:
            raise UserError(f"calibration: search.planners: {error}") from None
        if found != frozen:
            raise UserError(
                f"calibration: planner {name} has changed: what it does has the hash {found}, "
                f"frozen is {frozen}; a world must not be judged by a planner made for it: undo "
                "the change, or freeze the new hash and search anew under another --name"
            )
