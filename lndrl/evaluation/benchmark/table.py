"""The paper's table beside ours, for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table

from lndrl.evaluation.benchmark.figures import OURS, Row, mcnemar
from lndrl.evaluation.benchmark.paper import EPISODES, SCENARIOS, published
from lndrl.evaluation.metrics import Rate, Spread
from lndrl.evaluation.tables import RATES, SPREADS

HAZARD = "h (‰)"
"""Head of the column of hazards: lost per 1,000 control steps."""
_RATES = [short for short, _ in RATES.values()]
_RATES.insert(_RATES.index("LR") + 1, HAZARD)  # who collides early is seldom lost
_PAPER_FIELDS = {"arrival": "ar", "collision": "cr", "lost": "lr", "stuck": "sr"}


@dataclass(frozen=True)
class Cell:
    """A figure, None where no episode counts, and its 95 % interval where one is known."""

    value: float | None
    interval: tuple[float, float] | None = None
    digits: int = 3

    @property
    def words(self) -> str:
        """The figure with its digits, else a dash."""
        return "-" if self.value is None else f"{self.value:.{self.digits}f}"


def metric_head() -> list[str]:
    """Heads of the columns that ``metric_cells`` and ``published_cells`` fill."""
    return [*_RATES, *(short for short, _ in SPREADS.values())]


def metric_cells(row: Row) -> list[Cell]:
    """The nine metrics of ``row`` and the hazard; a mean of no episode is None."""
    metrics = row.metrics
    rates: list[Rate] = [getattr(metrics, name) for name in RATES]
    cells = [Cell(rate.value, rate.interval) for rate in rates]
    hazard = row.hazard
    cells.insert(_RATES.index(HAZARD), Cell(hazard.value, hazard.interval, 2))
    spreads: list[Spread] = [getattr(metrics, name) for name in SPREADS]
    return [*cells, *(Cell(spread.mean, _not_negative(spread)) for spread in spreads)]


def published_cells(method: str) -> list[str] | None:
    """The paper's figures for ``method``, without a hazard; None where it has none."""
    row = published(method)
    if row is None:
        return None
    values = (getattr(row, _PAPER_FIELDS.get(n, n)) for n in (*RATES, *SPREADS))
    figures = [f"{value:.3f}" for value in values]
    figures.insert(_RATES.index(HAZARD), "-")
    return figures


def benchmark_table(rows: Sequence[Row], title: str) -> Table:
    """Ours with Wilson 95 % intervals, the paper's figures below each, and McNemar's p.

    Beside each lost rate stands the hazard: lost per 1,000 control steps; beside the means their
    standard deviations.

    p is of the arrivals against those of ``OURS``, episode by episode.
    """
    table = Table(title=title, title_justify="left")
    table.add_column("method")
    for short in ("episodes", *metric_head()):
        table.add_column(short, justify="right")
    ours = next((row for row in rows if row.method == OURS), None)
    if ours is not None:
        table.add_column("p", justify="right")
    for row in rows:
        rates = [under(cell) for cell in metric_cells(row)[: len(_RATES)]]
        metrics = row.metrics
        spreads = (_spread(getattr(metrics, name)) for name in SPREADS)
        p = [] if ours is None or row is ours else [probability(mcnemar(ours, row).p)]
        table.add_row(row.method, f"{len(row.records):,}", *rates, *spreads, *p)
        figures = published_cells(row.method)
        if figures is not None:
            table.add_row("  published", f"{EPISODES * SCENARIOS:,}", *figures, style="dim")
    return table


def under(cell: Cell) -> str:
    """A figure and below it the interval."""
    if cell.interval is None:
        return cell.words
    low, high = cell.interval
    return f"{cell.words}\n{low:.2f}-{high:.2f}"


def probability(p: float) -> str:
    """``p`` to three digits."""
    return "<0.001" if p < 0.001 else f"{p:.3f}"


def _not_negative(spread: Spread) -> tuple[float, float] | None:
    """The interval of a mean of what is never below 0, which a normal one knows nothing of."""
    if spread.interval is None:
        return None
    low, high = spread.interval
    return max(low, 0.0), high


def _spread(spread: Spread) -> str:
    if spread.mean is None:
        return "-"
    return f"{spread.mean:.3f}\n±{spread.deviation:.3f}"
