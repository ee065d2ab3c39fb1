"""What the search for the bench's readings found, for a terminal."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence

from rich.table import Table

from lndrl.evaluation.benchmark.calibration import METHOD, SearchSpec
from lndrl.evaluation.benchmark.halving import Search
from lndrl.evaluation.benchmark.search import (
    CAREFUL,
    CAREFUL_AT_MOST,
    PREDICTIVE,
    PREDICTIVE_AT_LEAST,
    Verdict,
    row_targets,
    spread_of,
    variance_target,
)


def search_table(spec: SearchSpec, verdicts: Sequence[Verdict]) -> Table:
    """A row per judged world: DWA's figures, those off target marked, and hazards."""
    wanted = [*row_targets(), variance_target()]
    table = Table(
        title=f"{spec.judged} episodes per scenario, seed {spec.judge_seed}", title_justify="left"
    )
    table.add_column("world")
    for target in wanted:
        table.add_column(target.column, justify="right")
    for head in (f"lost/1000 {METHOD}", f"{CAREFUL} / {METHOD}", f"{PREDICTIVE} / {METHOD}"):
        table.add_column(head, justify="right")
    bounds = (f"{t.least:.2f}-{t.most:.2f}" for t in wanted)
    asked = (f"<= {CAREFUL_AT_MOST:.2f}", f">= {PREDICTIVE_AT_LEAST:.2f}")
    table.add_row("  target", *bounds, "", *asked, style="dim")
    for verdict in verdicts:
        figures = verdict.rows[METHOD].to_dict()
        cells = [_marked(figures[t.name], t.met(figures[t.name])) for t in wanted]
        hazard = verdict.hazard(METHOD)
        low, high = hazard.interval if hazard else (0.0, 0.0)
        own = f"{hazard.value:.2f}\n{low:.2f}-{high:.2f}" if hazard else ""
        table.add_row(
            verdict.world.name,
            *cells,
            own,
            _ratio(verdict, CAREFUL, lambda value: value <= CAREFUL_AT_MOST),
            _ratio(verdict, PREDICTIVE, lambda value: value >= PREDICTIVE_AT_LEAST),
        )
    return table


def search_lines(search: Search, verdicts: Sequence[Verdict]) -> list[str]:
    """What all worlds together say, in words."""
    met = [verdict for verdict in verdicts if not verdict.missed]
    lines = [
        f"{len(search.worlds)} worlds, {len(verdicts)} judged, {len(met)} meet DWA's row (a)",
        f"of these {sum(bool(v.matters) for v in met)} meet (b): behaviour matters; "
        f"{sum(v.variance_met for v in met)} meet (c): the sum of variances",
    ]
    for method in (CAREFUL, PREDICTIVE):
        ratios = spread_of(verdicts, method)
        if ratios:
            lines.append(
                f"hazard of {method} over DWA's in worlds that meet (a): "
                f"{ratios[0]:.2f} to {ratios[-1]:.2f}, median {statistics.median(ratios):.2f}"
            )
    return lines


def _marked(value: float | None, met: bool) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if met else f"[yellow]{value:.3f} *[/yellow]"


def _ratio(verdict: Verdict, method: str, fits: Callable[[float], bool]) -> str:
    if method not in verdict.rows:
        return "-"
    value, (low, high) = verdict.ratio(method)
    if value is None:
        return "-"
    words = f"{value:.2f}" if fits(value) else f"[yellow]{value:.2f} *[/yellow]"
    return f"{words}\n{low:.2f}-{high:.2f}"
