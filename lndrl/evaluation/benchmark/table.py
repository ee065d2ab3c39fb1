"""The paper's table beside ours, for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from lndrl.evaluation.benchmark.figures import OURS, Row, mcnemar
from lndrl.evaluation.benchmark.paper import PAPER
from lndrl.evaluation.hazard import Hazard
from lndrl.evaluation.metrics import Rate, Spread
from lndrl.evaluation.tables import RATES, SPREADS

HAZARD = "h (‰)"
"""Head of the column of hazards: lost per 1,000 control steps."""
_RATES = [short for short, _ in RATES.values()]
_RATES.insert(_RATES.index("LR") + 1, HAZARD)  # who collides early is seldom lost
_PAPER_FIELDS = {"arrival": "ar", "collision": "cr", "lost": "lr", "stuck": "sr"}


def benchmark_table(rows: Sequence[Row], title: str) -> Table:
    """Ours with Wilson 95 % intervals, the paper's figures below each, and McNemar's p.

    Beside each lost rate stands the hazard: lost per 1,000 control steps.

    p is of the arrivals against those of ``OURS``, episode by episode.
    """
    table = Table(title=title, title_justify="left")
    table.add_column("method")
    for short in ("episodes", *_RATES, *(short for short, _ in SPREADS.values())):
        table.add_column(short, justify="right")
    ours = next((row for row in rows if row.method == OURS), None)
    if ours is not None:
        table.add_column("p", justify="right")
    for row in rows:
        metrics = row.metrics
        rates = [_rate(getattr(metrics, name)) for name in RATES]
        rates.insert(_RATES.index(HAZARD), _hazard(row.hazard))
        spreads = (_spread(getattr(metrics, name)) for name in SPREADS)
        p = [] if ours is None or row is ours else [_probability(mcnemar(ours, row).p)]
        table.add_row(row.method, f"{len(row.records):,}", *rates, *spreads, *p)
        published = PAPER.get(row.method)
        if published is not None:
            values = (getattr(published, _PAPER_FIELDS.get(n, n)) for n in (*RATES, *SPREADS))
            figures = [f"{value:.3f}" for value in values]
            figures.insert(_RATES.index(HAZARD), "-")
            table.add_row("  published", "2,500", *figures, style="dim")
    return table


def _rate(rate: Rate) -> str:
    low, high = rate.interval
    return f"{rate.value:.3f}\n{low:.2f}-{high:.2f}"


def _hazard(hazard: Hazard) -> str:
    low, high = hazard.interval
    return f"{hazard.value:.2f}\n{low:.2f}-{high:.2f}"


def _spread(spread: Spread) -> str:
    if spread.mean is None:
        return "-"
    return f"{spread.mean:.3f}\n±{spread.deviation:.3f}"


def _probability(p: float) -> str:
    return "<0.001" if p < 0.001 else f"{p:.3f}"
