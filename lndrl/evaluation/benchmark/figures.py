"""What a results folder says: the nine metrics per method, and who differs from whom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from scipy.stats import binomtest

from lndrl.errors import UserError
from lndrl.evaluation.benchmark.store import IDENTITY, Identity, ResultsFolder
from lndrl.evaluation.hazard import Hazard
from lndrl.evaluation.metrics import Metrics, metrics_of
from lndrl.navigation import EpisodeRecord

OURS = "lndrl"
"""The method that the others are compared with."""


@dataclass(frozen=True)
class Row:
    """A method over some scenarios: episodes by (scenario, number), of a version of the bench."""

    method: str
    scenarios: tuple[str, ...]
    records: dict[tuple[str, int], EpisodeRecord]
    bench_version: int = 1

    @property
    def metrics(self) -> Metrics:
        """The nine metrics over all episodes; scenarios have as many each, so they count alike."""
        return metrics_of([self.records[key] for key in sorted(self.records)])

    def within(self, scenario: str) -> Row:
        """The same of one scenario."""
        inside = {key: record for key, record in self.records.items() if key[0] == scenario}
        return Row(self.method, (scenario,), inside, self.bench_version)

    @property
    def hazard(self) -> Hazard:
        """Of getting lost, over the steps of all episodes."""
        return Hazard.of(list(self.records.values()))

    def to_dict(self) -> dict[str, Any]:
        """Plain types: means under the names of the paper's columns; None where none counts.

        ``hazard`` is lost per 1,000 control steps.
        """
        m, hazard = self.metrics, self.hazard
        return {
            "method": self.method,
            "scenarios": list(self.scenarios),
            "episodes": len(self.records),
            "ar": m.arrival.value,
            "cr": m.collision.value,
            "lr": m.lost.value,
            "sr": m.stuck.value,
            "hazard": hazard.value,
            "reach_time": m.reach_time.mean,
            "distance": m.distance.mean,
            "position_error": m.position_error.mean,
            "angle_error": m.angle_error.mean,
            "variance_sum": m.variance_sum.mean,
            "intervals": {
                "ar": list(m.arrival.interval),
                "cr": list(m.collision.interval),
                "lr": list(m.lost.interval),
                "sr": list(m.stuck.interval),
                "hazard": list(hazard.interval),
            },
            "bench_version": self.bench_version,
        }


@dataclass(frozen=True)
class Paired:
    """How often one of two methods reached the goal in an episode where the other did not.

    ``p`` is McNemar's exact two-sided probability of such a difference by chance.
    """

    only_first: int
    only_second: int
    p: float


def rows_of(
    folder: ResultsFolder,
    methods: Sequence[str] | None = None,
    scenarios: Sequence[str] | None = None,
    episodes: int | None = None,
) -> list[Row]:
    """A row per method of ``folder``: the first ``episodes`` of each scenario, by default all.

    Only scenarios that a method has episodes in count for it. Raises UserError when ``folder``
    holds no results.
    """
    identity = Identity.read(folder.path / IDENTITY)
    rows = []
    for method in methods if methods is not None else list(identity.methods):
        found: dict[tuple[str, int], EpisodeRecord] = {}
        tested = []
        for scenario in scenarios if scenarios is not None else list(identity.scenarios):
            records = folder.records(method, scenario)
            inside = {k: r for k, r in records.items() if episodes is None or k < episodes}
            if inside:
                tested.append(scenario)
                found |= {(scenario, k): r for k, r in inside.items()}
        if found:
            rows.append(Row(method, tuple(tested), found, identity.bench_version))
    if not rows:
        raise UserError(f"{folder.path}: holds no finished episode of what was asked for")
    return rows


def mcnemar(first: Row, second: Row, outcome: str = "arrived") -> Paired:
    """Compare two methods in the episodes that both have driven."""
    shared = first.records.keys() & second.records.keys()
    ours = {key for key in shared if first.records[key].outcome == outcome}
    theirs = {key for key in shared if second.records[key].outcome == outcome}
    a, b = len(ours - theirs), len(theirs - ours)
    return Paired(a, b, float(binomtest(a, a + b).pvalue) if a + b else 1.0)


def summary_of(identity: Identity, rows: Sequence[Row], episodes: int) -> dict[str, Any]:
    """Everything about a finished benchmark, for ``summary.json``."""
    by_scenario = [row.within(scenario) for row in rows for scenario in row.scenarios]
    return {
        **vars(identity),
        "episodes": episodes,
        "results": [row.to_dict() for row in rows],
        "by_scenario": [row.to_dict() for row in by_scenario],
    }
