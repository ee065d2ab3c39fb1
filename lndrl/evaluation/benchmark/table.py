"""The paper's table beside ours, for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from lndrl.evaluation.benchmark.figures import OURS, Row, mcnemar
from lndrl.evaluation.benchmark.paper import PAPER
from lndrl.evaluation.metrics import Rate, Spread
from lndrl.evaluation.tables import RATES, SPREADS

_PAPER_FIELDS = {"arrival": "ar", "collision": "cr", "lost": "lr", "stuck": "sr"}


def benchmark_table(rows: Sequence[Row], title: str) -> Table:
    """Ours with Wilson 95 % intervals, the paper's figures below each, and McNemar's p.

    p is of the arrivals against those of ``OURS``, episode by episode.
    """
    table = Table(title=title, title_justify="left")
    table.add_column("method")
    table.add_column("episodes", justify="right")
    for short, _ in (*RATES.values(), *SPREADS.values()):
        table.add_column(short, justify="right")
    ours = next((row for row in rows if row.method == OURS), None)
    if ours is not None:
        table.add_column("p", justify="right")
    for row in rows:
        metrics = row.metrics
        rates = (_rate(getattr(metrics, name)) for name in RATES)
        spreads = (_spread(getattr(metrics, name)) for name in SPREADS)
        p = [] if ours is None or row is ours else [_probability(mcnemar(ours, row).p)]
        table.add_row(row.method, f"{len(row.records):,}", *rates, *spreads, *p)
        published = PAPER.get(row.method)
        if published is not None:
            values = (getattr(published, _PAPER_FIELDS.get(n, n)) for n in (*RATES, *SPREADS))
            table.add_row("  paper", "2,500", *(f"{v:.3f}" for v in values), style="dim")
    return table


def _rate(rate: Rate) -> str:
    low, high = rate.interval
    return f"{rate.value:.3f}\n{low:.2f}-{high:.2f}"


def _spread(spread: Spread) -> str:
    if spread.mean is None:
        return "-"
    return f"{spread.mean:.3f}\n±{spread.deviation:.3f}"


def _probability(p: float) -> str:
    return "<0.001" if p < 0.001 else f"{p:.3f}"
