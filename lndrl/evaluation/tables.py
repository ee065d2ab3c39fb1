"""Evaluation results as tables for a terminal: one planner in full, several side by side."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from lndrl.errors import UserError
from lndrl.evaluation.metrics import Rate, Spread
from lndrl.evaluation.result import EvaluationResult

RATES = {
    "arrival": ("AR", "arrival rate"),
    "collision": ("CR", "collision rate"),
    "lost": ("LR", "lost rate"),
    "stuck": ("SR", "stuck rate"),
}
SPREADS = {
    "reach_time": ("t (s)", "reach time (s)"),
    "distance": ("d (m)", "moving distance (m)"),
    "position_error": ("e_p (m)", "position error (m)"),
    "angle_error": ("e_α (rad)", "angle error (rad)"),
    "variance_sum": ("Σ_v", "sum of variances"),
}


def result_table(result: EvaluationResult, asked: int | None = None) -> Table:
    """The nine metrics of one planner, rates with their Wilson 95 % intervals.

    ``asked``: how many episodes were wanted, where it was stopped before all had ended.
    """
    title = describe(result)
    if asked is not None:
        # Whoever fails early ends early, so rates so far are no estimate of the rest.
        title = f"UNFINISHED, {len(result.records)} of {asked} episodes, the quickest: {title}"
    table = Table(title=title, title_justify="left")
    table.add_column("metric")
    table.add_column("mean", justify="right")
    table.add_column("std", justify="right")
    table.add_column("95 % interval", justify="right")
    table.add_column("episodes", justify="right")
    for name, (short, long) in RATES.items():
        rate: Rate = getattr(result.metrics, name)
        low, high = rate.interval
        table.add_row(
            f"{short}  {long}",
            f"{rate.value:.3f}",
            "",
            f"{low:.3f} to {high:.3f}",
            f"{rate.count} of {rate.episodes}",
        )
    for name, (_, long) in SPREADS.items():
        spread: Spread = getattr(result.metrics, name)
        table.add_row(
            long, _number(spread.mean), _number(spread.deviation), "", str(spread.episodes)
        )
    if result.vetoes is not None:
        steps = sum(record.steps for record in result.records)
        share = result.vetoes / max(steps, 1)
        counts = f"{result.vetoes:,} of {steps:,} steps"
        table.add_row(
            f"vetoed by the {'guard' if result.planner.endswith('+guard') else 'shield'}",
            _number(share),
            "",
            counts,
            "",
        )
    for name, value in result.own_metrics.items():
        table.add_row(name, _number(value), "", "", "")
    return table


def comparison_table(results: Sequence[EvaluationResult]) -> Table:
    """One row per planner in the layout of the paper's Table II.

    Raises UserError when the results stem from different scenarios, seeds or numbers of
    episodes: the planners then did not face the same episodes.
    """
    settings = {(r.scenario, r.localization, r.seed, len(r.records)) for r in results}
    if len(settings) != 1:
        found = "; ".join(describe(result) for result in results)
        raise UserError(f"only results of the same episodes can be compared, not {found}")
    table = Table(title=describe(results[0], planner=False), title_justify="left")
    table.add_column("planner")
    own = results[0].own_metrics
    for short in (*(short for short, _ in (*RATES.values(), *SPREADS.values())), *own):
        table.add_column(short, justify="right")
    for result in results:
        rates = (_rate(getattr(result.metrics, name)) for name in RATES)
        spreads = (_spread(getattr(result.metrics, name)) for name in SPREADS)
        figures = (_number(result.own_metrics.get(name)) for name in own)
        table.add_row(planner_words(result), *rates, *spreads, *figures)
    return table


def describe(result: EvaluationResult, planner: bool = True) -> str:
    """One line: who ran what, e.g. ``straight on hybrid: 60 episodes, seed 0, amcl``."""
    who = f"{planner_words(result)} on " if planner else ""
    count = len(result.records)
    return (
        f"{who}{result.scenario}: {count} episode{'s' * (count != 1)}, seed {result.seed}, "
        f"{result.localization} localization"
    )


def planner_words(result: EvaluationResult) -> str:
    """What a planner is called in a table: its name, and how its actions were chosen."""
    if result.temperature != 1.0:
        return f"{result.planner} (temperature {result.temperature:g})"
    return f"{result.planner} (greedy)" if result.actions == "greedy" else result.planner


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _spread(spread: Spread) -> str:
    return f"{_number(spread.mean)}/{_number(spread.deviation)}" if spread.episodes else "–"


def _rate(rate: Rate) -> str:
    low, high = rate.interval
    return f"{rate.value:.3f}\n{low:.2f}–{high:.2f}"
