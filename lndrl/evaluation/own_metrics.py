"""Metrics of a user's own beside the nine: a number per planner, from its episodes' records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from lndrl.errors import UserError
from lndrl.evaluation.result import EvaluationResult
from lndrl.extensions import METRIC, calling, find, make


@dataclass(frozen=True)
class OwnMetric:
    """A metric that ``name`` stands for; ``label`` heads its column."""

    name: str
    label: str
    metric: Any

    def of(self, result: EvaluationResult) -> float | None:
        """Its number for ``result``, None where no episode counts; raises UserError otherwise."""
        with calling(METRIC, self.name):
            answer = self.metric(result.records)
            value = None if answer is None else float(answer)
        if value is not None and not math.isfinite(value):
            raise UserError(
                f"metric {self.name}: {value} for {result.planner} is no figure; return None where "
                "no episode counts"
            )
        return value


def own_metrics(names: Sequence[str]) -> list[OwnMetric]:
    """The metrics that ``names`` stand for, each an object of its class.

    Raises UserError where one is not trusted, not there, or not what it should be, and where two
    would have one column.
    """
    found: list[OwnMetric] = []
    for name in dict.fromkeys(names):
        kind = find(METRIC, name, where="--metric")
        assert kind is not None  # the nine are not named
        label = name.rpartition(":")[2]
        if any(label == other.label for other in found):
            raise UserError(f"--metric {name}: another one is called {label}, too; rename a class")
        found.append(OwnMetric(name, label, make(METRIC, kind, name)))
    return found


def add_metrics(result: EvaluationResult, metrics: Sequence[OwnMetric]) -> EvaluationResult:
    """``result`` with what ``metrics`` say of it."""
    return replace(result, own_metrics={each.label: each.of(result) for each in metrics})
