"""Which of all readings of what the paper leaves open is the bench: criteria, and who is dropped.

A combination of the factors' values is a world. Successive halving (Jamieson and Talwalkar
2016, without its fixed share): few episodes for all, more for those that are left, and only what is
excluded at two deviations is dropped. What is judged is judged once, on episodes that no round saw.

Criteria, in this order, all from the paper's table: (a) DWA fares here as it did there; (b) a robot
that minds its belief gets lost less often per step than DWA, one that does not, more often; (c) the
sum of variances. No learned policy is looked at.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lndrl.evaluation.benchmark.calibration import METHOD, Changes, SearchSpec, Target, targets
from lndrl.evaluation.benchmark.figures import Row
from lndrl.evaluation.hazard import Hazard, hazard_ratio
from lndrl.evaluation.metrics import Metrics, Rate, Spread

EXCLUDED_AT = 2.0
"""Standard errors outside of what is allowed that a figure must lie to be held against a world."""
CAREFUL, PREDICTIVE = "careful", "predictive"
CAREFUL_AT_MOST = 1 / 5
"""Of DWA's hazard; the paper's LNDRL has about a tenth of it."""
PREDICTIVE_AT_LEAST = 1.3
"""Times DWA's hazard; the paper's DRL baselines have about 1.6 times its lost rate."""
_METRIC = {
    "ar": "arrival", "cr": "collision", "lr": "lost", "sr": "stuck", "reach_time": "reach_time",
    "distance": "distance", "position_error": "position_error", "angle_error": "angle_error",
    "variance_sum": "variance_sum",
}  # fmt: skip


@dataclass(frozen=True)
class World:
    """One reading of everything: a value of every factor, and what they change."""

    values: tuple[tuple[str, str], ...]
    readings: tuple[Changes, ...] = ()

    def changes(self, scenario: str) -> list[str]:
        """Of one scenario, key=value."""
        return [change for each in self.readings for change in each.changes(scenario)]

    @property
    def name(self) -> str:
        """Its values, fit for a folder's name."""
        return "+".join(value for _, value in self.values)


def worlds_of(spec: SearchSpec) -> list[World]:
    """Combinations of the factors' values in the order of the file: all, or ``spec.worlds`` of
    them, drawn by ``spec.seed`` (Bergstra and Bengio 2012: with some factors that hardly matter,
    that tells more than a coarser grid)."""
    choices = [
        [(factor, value, changes) for value, changes in each.values.items()]
        for factor, each in spec.factors.items()
    ]
    worlds = [
        World(
            tuple((factor, value) for factor, value, _ in combination),
            tuple(changes for _, _, changes in combination),
        )
        for combination in itertools.product(*choices)
    ]
    if spec.worlds is None or spec.worlds >= len(worlds):
        return worlds
    # Whoever draws more has all that fewer had.
    order = np.random.Generator(np.random.PCG64(spec.seed)).permutation(len(worlds))
    return [worlds[i] for i in sorted(order[: spec.worlds].tolist())]


def row_targets() -> list[Target]:
    """Criterion (a): DWA's row but for the sum of variances, getting lost within 0.02 to 0.05."""
    wanted = [target for target in targets() if target.name != "variance_sum"]
    return [
        Target("lr", target.column, target.value, 0.02, 0.05) if target.name == "lr" else target
        for target in wanted
    ]


def variance_target() -> Target:
    """Criterion (c)."""
    return next(target for target in targets() if target.name == "variance_sum")


def standard_error(metrics: Metrics, name: str) -> float:
    """Of the figure ``name`` of a row; of a rate by Wilson's shrunk rate, so it is never 0."""
    metric: Rate | Spread = getattr(metrics, _METRIC[name])
    if isinstance(metric, Rate):
        rate = (metric.count + 2) / (metric.episodes + 4)
        return float((rate * (1 - rate) / max(metric.episodes, 1)) ** 0.5)
    if metric.deviation is None or not metric.episodes:
        return float("inf")
    return float(metric.deviation / metric.episodes**0.5)


def excluded_by(row: Row) -> list[str]:
    """Columns of (a) in which ``row`` is off by more than ``EXCLUDED_AT`` standard errors."""
    figures, metrics = row.to_dict(), row.metrics
    found = []
    for target in row_targets():
        value = figures[target.name]
        slack = EXCLUDED_AT * standard_error(metrics, target.name)
        off = value is None or not target.least - slack <= value <= target.most + slack
        if off and slack != float("inf"):
            found.append(target.column)
    return found


def missed_by(row: Row) -> list[str]:
    """Columns of (a) that ``row`` does not meet as it stands."""
    figures = row.to_dict()
    return [target.column for target in row_targets() if not target.met(figures[target.name])]


def farness(row: Row) -> float:
    """How far (a) is missed: the widths of targets by which figures lie outside, summed."""
    figures = row.to_dict()
    total = 0.0
    for target in row_targets():
        value = figures[target.name]
        if value is None:
            return float("inf")
        outside = max(target.least - value, value - target.most, 0.0)
        total += outside / (target.most - target.least)
    return total


@dataclass(frozen=True)
class Verdict:
    """What a world's judgement came to; ``rows`` by method."""

    world: World
    rows: Mapping[str, Row]

    @property
    def missed(self) -> list[str]:
        """Columns of (a)."""
        return missed_by(self.rows[METHOD])

    def hazard(self, method: str) -> Hazard | None:
        """Of getting lost; None where the method was not driven."""
        row = self.rows.get(method)
        return None if row is None else row.hazard

    def ratio(self, method: str) -> tuple[float | None, tuple[float, float]]:
        """The method's hazard over DWA's, with its 95 % interval."""
        own, reference = self.hazard(method), self.hazard(METHOD)
        if own is None or reference is None:
            return None, (0.0, float("inf"))
        return hazard_ratio(own, reference)

    @property
    def matters(self) -> bool | None:
        """Criterion (b); None where it was not asked."""
        careful, predictive = self.ratio(CAREFUL)[0], self.ratio(PREDICTIVE)[0]
        if careful is None or predictive is None:
            return None
        return careful <= CAREFUL_AT_MOST and predictive >= PREDICTIVE_AT_LEAST

    @property
    def variance_met(self) -> bool:
        """Criterion (c)."""
        return variance_target().met(self.rows[METHOD].metrics.variance_sum.mean)

    def order(self) -> tuple[Any, ...]:
        """Sorts the best first: (a), then (b), then how near each is."""
        careful = self.ratio(CAREFUL)[0]
        return (
            bool(self.missed),
            not self.matters,
            farness(self.rows[METHOD]) if self.missed else 0.0,
            float("inf") if careful is None else careful,
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        return {
            "world": self.world.name,
            "values": dict(self.world.values),
            "changes": [each.model_dump(mode="json") for each in self.world.readings],
            "meets_row": not self.missed,
            "missed": self.missed,
            "matters": self.matters,
            "meets_variance": self.variance_met,
            "rows": {method: row.to_dict() for method, row in self.rows.items()},
            "ratios": {
                method: {"value": value, "interval": list(interval)}
                for method in self.rows
                if method != METHOD
                for value, interval in [self.ratio(method)]
            },
        }


def spread_of(verdicts: Sequence[Verdict], method: str) -> list[float]:
    """The ratios of ``method`` over all worlds that meet (a), ascending: nobody picked among them
    for it."""
    ratios = (v.ratio(method)[0] for v in verdicts if not v.missed)
    return sorted(ratio for ratio in ratios if ratio is not None)
