"""How often methods arrive, collide and get lost: a dot with its interval, and the paper's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from lndrl.view.palette import INK, OUTCOME, OUTCOME_WORD, PAPER, SLATE
from lndrl.view.pictures.axes import quiet
from lndrl.view.pictures.fitting import shortened

_WIDTH, _ROW, _REST = 4.4, 0.3, 0.95  # inches
_NAME = 1.3  # inches that the longest name may take


@dataclass(frozen=True)
class Share:
    """Of one method: a share of its episodes, its interval, and the paper's where there is one."""

    method: str
    value: float
    interval: tuple[float, float]
    published: float | None = None


def rates_figure(outcome: str, shares: Sequence[Share]) -> Figure:
    """A line for each of ``shares`` (one or more) that ended in ``outcome``, in per cent.

    A filled dot with its interval is ours, a hollow diamond the paper's.
    """
    colour = OUTCOME[outcome]
    height = _REST + _ROW * len(shares)
    figure = Figure(figsize=(_WIDTH, height), facecolor=PAPER, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for row, share in enumerate(shares):
        low, high = (100 * end for end in share.interval)
        axes.plot([low, high], [row, row], color=colour, linewidth=2.0, alpha=0.7, zorder=3)
        axes.scatter([100 * share.value], [row], s=34, color=colour, linewidths=0, zorder=4)
        if share.published is not None:
            axes.scatter(
                [100 * share.published], [row], s=36, marker="D", facecolors=PAPER,
                edgecolors=INK, linewidths=1.2, zorder=5,
            )  # fmt: skip
    names = [shortened(share.method, 8.5, _NAME) for share in shares]
    axes.set_yticks(range(len(shares)), names)
    axes.set_ylim(len(shares) - 0.5, -0.5)
    axes.set_title(
        f"{OUTCOME_WORD[outcome]}, 95 % interval; ◇: the paper", loc="left", size=9.5, color=INK
    )
    quiet(axes)
    axes.grid(axis="x", color=SLATE, alpha=0.22, linewidth=0.7)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g} %"))
    axes.margins(x=0.04)
    return figure
