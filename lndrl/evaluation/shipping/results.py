"""What the shipped policy reaches, place by place, as ``lndrl evaluate --bench`` would say it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from lndrl.config import RunConfig
from lndrl.evaluation.benchmark import BenchmarkSpec, Contender, bench_config
from lndrl.evaluation.hazard import Hazard
from lndrl.evaluation.result import EvaluationResult
from lndrl.planners import PlannerSource, ShieldConfig

RATES = ("arrival", "collision", "lost", "stuck")


def testing(source: PlannerSource, bench: BenchmarkSpec, scenario: str) -> RunConfig:
    """What ``source`` is tested under in ``scenario``: the bench's world, filter and limits."""
    changes = bench.changes_in(scenario)
    return bench_config(Contender(source.label, source, "amcl"), scenario, bench.seed, changes)


def cell_of(
    source: PlannerSource, bench: BenchmarkSpec, scenario: str, shield: bool
) -> tuple[PlannerSource, RunConfig]:
    """``source`` with or without a shield, and what it is tested under."""
    chosen = replace(source, shield=ShieldConfig() if shield else None)
    return chosen, testing(chosen, bench, scenario)


def measured(result: EvaluationResult) -> dict[str, Any]:
    """The figures of one cell, plain types for JSON; counts, so that cells can be added up."""
    metrics = result.metrics
    hazard = Hazard.of(result.records)
    return {
        "scenario": result.scenario,
        "shield": result.vetoes is not None,
        "episodes": len(result.records),
        "seed": result.seed,
        "program_version": result.program_version,
        **{name: getattr(metrics, name).count for name in RATES},
        "steps": hazard.steps,
        "vetoes": result.vetoes,
        "reach_time": metrics.reach_time.mean,
        "position_error": metrics.position_error.mean,
    }
