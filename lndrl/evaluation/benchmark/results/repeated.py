"""Rows that were trained alike but for chance, and by how much chance moves them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from lndrl.evaluation.benchmark.figures import Row
from lndrl.evaluation.benchmark.results.goals import rate
from lndrl.evaluation.benchmark.spec import BenchmarkSpec
from lndrl.evaluation.estimate import Estimate
from lndrl.planners import is_rule

ENDS = ("arrived", "collided", "lost")


@dataclass(frozen=True)
class Repeated:
    """Two or more rows of one configuration, tested alike, each of a training of its own."""

    rows: tuple[Row, ...]

    @property
    def methods(self) -> list[str]:
        """Their names, in the order of the bench."""
        return [row.method for row in self.rows]

    def over_trainings(self, outcome: str) -> Estimate:
        """Mean over the trainings of how often an episode ends so, 0 to 1.

        Its interval is that of the *method*: what a training chances to come to is in it, which the
        interval of a single row, over its episodes, leaves out.
        """
        return Estimate.of(float(rate(row, outcome)) for row in self.rows)

    def chance(self, outcome: str) -> float:
        """How far two more such trainings are apart, 0 to 1: at most so in 95 % of cases."""
        apart = self.over_trainings(outcome).apart
        assert apart is not None  # of two or more
        return apart

    def to_dict(self) -> dict[str, Any]:
        """Plain types; rates, not points."""
        return {
            "methods": self.methods,
            **{
                outcome: self.over_trainings(outcome).to_dict() | {"chance": self.chance(outcome)}
                for outcome in ENDS
            },
        }


def repeated(bench: BenchmarkSpec, rows: Sequence[Row]) -> list[Repeated]:
    """Those of ``rows`` that differ in nothing but their training's chance, two or more together.

    Rows alike are of one configuration and tested in one way, with policies of different runs.
    Rows that ``bench`` does not know, and rules, are never among them.
    """
    alike: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        for key in _trained(bench, row.method):
            alike.setdefault(key, {}).setdefault(bench.methods[row.method].planner, row)
    return [Repeated(tuple(by_run.values())) for by_run in alike.values() if len(by_run) > 1]


def _trained(bench: BenchmarkSpec, name: str) -> Iterator[tuple[str, str]]:
    """With which configuration and how tested; nothing for a row without a training."""
    if name not in bench.methods or is_rule(bench.methods[name].planner):
        return
    tested = bench.methods[name].model_dump_json(exclude={"planner", "config", "seed"})
    yield bench.config_name(name), tested
