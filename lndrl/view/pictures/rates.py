"""How often methods arrive, collide and get lost: a dot with its interval, and the paper's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, MaxNLocator

from lndrl.evaluation.benchmark.paper import published
from lndrl.view.palette import INK, OUTCOME, OUTCOME_WORD, PAPER, SLATE
from lndrl.view.pictures.axes import quiet
from lndrl.view.pictures.fitting import shortened, wrapped

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark.results import Results

FIELDS = {
    "arrived": ("arrival", "ar"),
    "collided": ("collision", "cr"),
    "lost": ("lost", "lr"),
}
"""By outcome: a method's rate, and the same of the paper's row."""

_WIDTH, _ROW, _REST = 4.4, 0.3, 0.95  # inches
_NAME = 1.3  # inches that the longest name may take
_PAGE, _PAGE_ROW, _PAGE_REST, _PAGE_NAME = 12.0, 0.24, 1.35, 1.8  # inches


@dataclass(frozen=True)
class Share:
    """Of one method: a share of its episodes, its interval, and the paper's where there is one."""

    method: str
    value: float
    interval: tuple[float, float]
    published: float | None = None


def shares_of(results: Results, outcome: str) -> list[Share]:
    """How often the episodes of each row ended in ``outcome``, beside what the paper has."""
    name, field = FIELDS[outcome]
    found = []
    for row in results.rows:
        rate, paper = getattr(row.metrics, name), published(row.method)
        theirs = None if paper is None else float(getattr(paper, field))
        found.append(Share(row.method, rate.value, rate.interval, theirs))
    return found


def rates_figure(outcome: str, shares: Sequence[Share]) -> Figure:
    """A line for each of ``shares`` (one or more) that ended in ``outcome``, in per cent.

    A filled dot with its interval is ours, a hollow diamond the paper's.
    """
    height = _REST + _ROW * len(shares)
    figure = Figure(figsize=(_WIDTH, height), facecolor=PAPER, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _draw(axes, outcome, shares)
    _name_rows(axes, shares, _NAME)
    axes.set_title(
        f"{OUTCOME_WORD[outcome]}, 95 % interval; ◇: the paper", loc="left", size=9.5, color=INK
    )
    return figure


def results_figure(results: Results) -> Figure:
    """The table at a glance: arrived, collided and lost side by side, a line for each row."""
    panels = {outcome: shares_of(results, outcome) for outcome in FIELDS}
    first = next(iter(panels))
    height = _PAGE_REST + _PAGE_ROW * len(panels[first])
    layout = ConstrainedLayoutEngine(wspace=0.05)
    figure = Figure(figsize=(_PAGE, height), facecolor=PAPER, layout=layout)
    FigureCanvasAgg(figure)
    large, *small = figure.subplots(1, len(panels), sharey=True, width_ratios=(1.5, 1, 1))
    for axes, (outcome, shares) in zip((large, *small), panels.items(), strict=True):
        _draw(axes, outcome, shares)
        axes.set_title(OUTCOME_WORD[outcome], loc="left", size=10.5, color=INK)
    _name_rows(large, panels[first], _PAGE_NAME)
    for axes in small:
        axes.tick_params(axis="y", length=0)
    identity = results.identity
    words = (
        f"Version {identity.bench_version} of the bench, "
        f"{max(len(row.records) for row in results.rows):,} episodes a row. A dot is a row with "
        "its 95 % interval over episodes, a hollow diamond the paper's figure for it."
    )
    figure.suptitle(wrapped(words, 9.5, _PAGE - 0.4), x=0.01, ha="left", size=9.5, color=INK)
    return figure


def save_results(results: Results, path: Path | str, dpi: int = 130) -> None:
    """Write the table at a glance; raises OSError where ``path`` cannot be written."""
    results_figure(results).savefig(path, dpi=dpi)


def _draw(axes: Axes, outcome: str, shares: Sequence[Share]) -> None:
    """A line for each of ``shares``, the first on top."""
    colour = OUTCOME[outcome]
    for row, share in enumerate(shares):
        low, high = (100 * end for end in share.interval)
        axes.plot([low, high], [row, row], color=colour, linewidth=2.0, alpha=0.7, zorder=3)
        axes.scatter([100 * share.value], [row], s=34, color=colour, linewidths=0, zorder=4)
        if share.published is not None:
            axes.scatter(
                [100 * share.published], [row], s=36, marker="D", facecolors="none",
                edgecolors=INK, linewidths=1.2, zorder=5,
            )  # fmt: skip
    axes.set_ylim(len(shares) - 0.5, -0.5)
    quiet(axes)
    axes.grid(axis="x", color=SLATE, alpha=0.22, linewidth=0.7)
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g} %"))
    axes.margins(x=0.04)
    axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))  # a small difference looks small


def _name_rows(axes: Axes, shares: Sequence[Share], width: float) -> None:
    names = [shortened(share.method, 8.5, width) for share in shares]
    axes.set_yticks(range(len(shares)), names)
