"""A results folder as one page: rows, places, paired comparisons and goals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from lndrl.errors import UserError
from lndrl.evaluation.benchmark.figures import OURS, Row, rows_of
from lndrl.evaluation.benchmark.handing import check_bench, trainings_of
from lndrl.evaluation.benchmark.paper import EPISODES, published
from lndrl.evaluation.benchmark.results.goals import Verdict, verdicts
from lndrl.evaluation.benchmark.results.paired import Difference
from lndrl.evaluation.benchmark.results.repeated import Repeated, repeated
from lndrl.evaluation.benchmark.spec import BenchmarkSpec, choose
from lndrl.evaluation.benchmark.store import IDENTITY, Identity, ResultsFolder
from lndrl.evaluation.benchmark.trainings import Training


@dataclass(frozen=True)
class Comparison:
    """The reference less ``method``, in the episodes that both have driven."""

    method: str
    arrived: Difference
    lost: Difference


@dataclass(frozen=True)
class Results:
    """What ``folder`` holds of the bench's ``scenarios``.

    ``missing`` are the rows of the bench without an episode there. All others are compared with
    the row ``reference``; ``judged`` is the method that the goals are for, there or not.
    ``trained``: how the learned rows were, None where nobody knows any more. ``repeated``: whole
    rows that are trained alike but for chance.
    """

    folder: str
    identity: Identity
    scenarios: tuple[str, ...]
    rows: tuple[Row, ...]
    missing: tuple[str, ...]
    reference: Row
    judged: str
    trained: Mapping[str, Training | None] = field(default_factory=dict)
    repeated: tuple[Repeated, ...] = ()

    @property
    def name(self) -> str:
        """The folder's last part: what a document's marks name."""
        return self.folder.replace("\\", "/").rstrip("/").rpartition("/")[2]

    @cached_property
    def comparisons(self) -> list[Comparison]:
        """With every other row that shares an episode."""
        others = [row for row in self.rows if row is not self.reference and self._shares(row)]
        return [
            Comparison(
                row.method,
                Difference.of(self.reference, row, "arrived"),
                Difference.of(self.reference, row, "lost"),
            )
            for row in others
        ]

    @cached_property
    def goals(self) -> list[Verdict]:
        """Of rows that are whole; others count as not there yet.

        What is seen of a judged row that is not whole is shown, and decides nothing.
        """
        whole = {row.method: row for row in self.rows if self.is_whole(row)}
        begun = {row.method: row for row in self.rows if row.method == self.judged}
        found = verdicts(self.judged, {**begun, **whole})
        return [each if self.judged in whole else replace(each, met=None) for each in found]

    @property
    def trainings(self) -> list[tuple[Training, list[str]]]:
        """Each training that is known, and the rows that were tested of it."""
        found: dict[str, tuple[Training, list[str]]] = {}
        for name, training in self.trained.items():
            if training is not None:
                found.setdefault(training.policy, (training, []))[1].append(name)
        return list(found.values())

    @property
    def whole(self) -> int:
        """Episodes that a whole row has at least."""
        return EPISODES * len(self.scenarios)

    def is_whole(self, row: Row) -> bool:
        """Whether ``row`` has as many episodes of each scenario as the paper."""
        counts = dict.fromkeys(self.scenarios, 0)
        for scenario, _ in row.records:
            counts[scenario] = counts.get(scenario, 0) + 1
        return all(counts[scenario] >= EPISODES for scenario in self.scenarios)

    def notes(self) -> list[str]:
        """Sentences on what is not there, or not whole."""
        found = []
        if self.missing:
            found.append(f"Not tested yet, and left out: {', '.join(self.missing)}.")
        parts = [r for r in self.rows if not self.is_whole(r)]
        if parts:
            words = ", ".join(f"{r.method} has {len(r.records):,}" for r in parts)
            found.append(
                f"Of {self.whole:,} episodes {words}; the goals take such rows as not there yet."
            )
        forgotten = [name for name, training in self.trained.items() if training is None]
        if forgotten:
            found.append(f"How they were trained is not kept there: {', '.join(forgotten)}.")
        strangers = [r.method for r in self.rows if r is not self.reference and not self._shares(r)]
        if strangers:
            found.append(
                f"Without an episode in common with {self.reference.method}, and not compared: "
                f"{', '.join(strangers)}."
            )
        if self.judged not in [row.method for row in self.rows]:
            found.append(f"The goals are for {self.judged}, which is not there yet.")
        return found

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain types."""
        return {
            "folder": self.folder,
            "bench_version": self.identity.bench_version,
            "seed": self.identity.seed,
            "reference": self.reference.method,
            "rows": [
                {**row.to_dict(), "paper": _published(row.method)} | _means(row)
                for row in self.rows
            ],
            "by_scenario": [row.within(s).to_dict() for row in self.rows for s in row.scenarios],
            "paired": [
                {
                    "method": each.method,
                    "episodes": each.arrived.episodes,
                    "arrived": each.arrived.to_dict(),
                    "lost": each.lost.to_dict(),
                }
                for each in self.comparisons
            ],
            "goals": {
                "method": self.judged,
                "verdicts": [verdict.to_dict() for verdict in self.goals],
            },
            "trainings": [
                {**training.to_dict(), "methods": names} for training, names in self.trainings
            ],
            "repeated": [each.to_dict() for each in self.repeated],
            "missing": list(self.missing),
            "notes": self.notes(),
        }

    def _shares(self, row: Row) -> bool:
        return not self.reference.records.keys().isdisjoint(row.records)


def gather(
    bench: BenchmarkSpec,
    folder: ResultsFolder,
    methods: Sequence[str] | None = None,
    reference: str | None = None,
) -> Results:
    """What ``folder`` holds of ``bench``, its rows in the bench's order.

    ``methods`` by default are all. The rest is compared with ``reference``, by default the
    program's own method, or where that is not there the first row that is.

    Raises UserError where ``folder`` holds no results, those of another bench, or no
    ``reference``, and for methods that neither knows.
    """
    check_bench(bench, folder)
    identity = Identity.read(folder.path / IDENTITY)
    known = [*bench.methods, *(name for name in identity.methods if name not in bench.methods)]
    wanted = choose(known, methods, "method")
    if reference is not None:
        wanted = list(dict.fromkeys([*wanted, *choose(known, [reference], "method")]))
    rows = rows_of(folder, wanted)
    by_name = {row.method: row for row in rows}
    if reference is not None and reference not in by_name:
        raise UserError(
            f"--reference {reference}: {folder.path} has no episode of it; "
            f"it has {', '.join(by_name)}"
        )
    found = Results(
        folder=str(folder.path),
        identity=identity,
        scenarios=tuple(bench.scenarios),
        rows=tuple(rows),
        missing=tuple(name for name in wanted if name not in by_name),
        reference=by_name[reference] if reference else by_name.get(OURS, rows[0]),
        judged=reference or OURS,
        trained=trainings_of(folder, list(by_name)),
    )
    whole = [row for row in found.rows if found.is_whole(row)]
    return replace(found, repeated=tuple(repeated(bench, whole)))


def _published(method: str) -> dict[str, Any] | None:
    row = published(method)
    return None if row is None else {k: v for k, v in vars(row).items() if k != "label"}


def _means(row: Row) -> dict[str, Any]:
    """95 % intervals of the means, under the names of the means."""
    metrics = row.metrics
    names = ("reach_time", "distance", "position_error", "angle_error", "variance_sum")
    found = {name: getattr(metrics, name).interval for name in names}
    return {"mean_intervals": {k: None if v is None else list(v) for k, v in found.items()}}
