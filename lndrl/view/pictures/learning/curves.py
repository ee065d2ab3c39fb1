"""Learning curves from the rows of ``metrics.jsonl``, as a picture and as a table."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.view.palette import (
    BLUE,
    INK,
    ORANGE,
    OUTCOME,
    OUTCOME_WORD,
    PAPER,
    VERMILLION,
)
from lndrl.view.pictures.axes import quiet
from lndrl.view.pictures.fitting import shortened
from lndrl.wilson import wilson_interval

COLUMNS = {
    "update": "update",
    "steps": "steps",
    "episodes": "episodes.count",
    "arrived": "episodes.arrived",
    "collided": "episodes.collided",
    "lost": "episodes.lost",
    "timeout": "episodes.timeout",
    "mean_return": "episodes.mean_return",
    "mean_time": "episodes.mean_time",
    "position_error": "episodes.position_error",
    "entropy": "ppo.entropy",
    "kl": "ppo.kl",
    "clip_fraction": "ppo.clip_fraction",
    "explained_variance": "ppo.explained_variance",
    "policy_loss": "ppo.policy_loss",
    "value_loss": "ppo.value_loss",
    "lag": "lag.mean",
}
"""Column of the table: dotted key in a row of metrics."""

SMOOTHING = 0.04
"""Share of the curve that one smoothed point averages over."""
_WORD = 0.13  # of the panel's width, for the longest name of a phase

Row = Mapping[str, Any]


def value_at(row: Row, key: str) -> float | None:
    """The finite number under the dotted ``key``, None where there is none."""
    value: Any = row
    for part in key.split("."):
        if not isinstance(value, Mapping) or part not in value:
            return None
        value = value[part]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return value


def column(rows: Sequence[Row], key: str) -> NDArray[np.float64]:
    """Values under the dotted ``key`` (n,), NaN where a row has none."""
    values = [value_at(row, key) for row in rows]
    return np.array([math.nan if value is None else value for value in values], np.float64)


def smooth(values: NDArray[np.float64], share: float = SMOOTHING) -> NDArray[np.float64]:
    """Centred moving mean over ``share`` of the points, blind to NaN; ends use what there is."""
    half = max(int(len(values) * share / 2), 0)
    known = np.isfinite(values)
    total = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(known)])
    index = np.arange(len(values))
    low, high = np.maximum(index - half, 0), np.minimum(index + half + 1, len(values))
    number = count[high] - count[low]
    mean = (total[high] - total[low]) / np.maximum(number, 1)
    return np.where(number > 0, mean, math.nan)


def write_csv(rows: Sequence[Row], path: Path | str) -> None:
    """Write COLUMNS of ``rows``, empty where a row has no number.

    Raises OSError where ``path`` cannot be written.
    """
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row in rows:
            writer.writerow(table_cell(value_at(row, key)) for key in COLUMNS.values())


def table_cell(value: float | None) -> str:
    """A number as the tables have it, nothing for None."""
    if value is None:
        return ""
    return str(value) if isinstance(value, int) else f"{value:.6g}"


def write_validated(curve: Sequence[Row], path: Path | str) -> None:
    """Write the shares of a validated ``curve``, sampled and greedy, a line per version.

    Raises OSError where ``path`` cannot be written.
    """
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        kinds = ("sampled", "greedy")
        names = ("arrived", "collided", "lost", "timeout")
        writer.writerow(["steps", "episodes", *(f"{kind}_{n}" for kind in kinds for n in names)])
        for row in curve:
            shares = [
                f"{row[kind][name] / row[kind]['episodes']:.6g}" for kind in kinds for name in names
            ]
            writer.writerow([row["steps"], row["sampled"]["episodes"], *shares])


def save_curves(
    rows: Sequence[Row],
    path: Path | str,
    title: str = "",
    dpi: int = 130,
    validated: Sequence[Row] = (),
) -> None:
    """Write the picture: outcome rates large, return, entropy and KL small, all over steps.

    Faint lines are raw, strong ones smoothed; dots with bars are the ``validated`` arrivals with
    their 95 % Wilson intervals, dotted lines where another phase begins. What ``rows`` lack stays
    an empty panel. Raises UserError without rows, OSError where ``path`` cannot be written.
    """
    if not rows:
        raise UserError(f"{path}: there is nothing to draw; learning curves need a row")
    figure = Figure(figsize=(12.0, 5.0), facecolor=PAPER, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.55, 1.0))
    steps = _steps_of(rows)
    large = figure.add_subplot(grid[:, 0])
    _draw_outcomes(large, steps, rows)
    _draw_phases(large, steps, rows)
    _draw_validated(large, validated)
    small = (
        ("mean return", "episodes.mean_return", BLUE),
        ("entropy (nat)", "ppo.entropy", ORANGE),
        ("KL per update", "ppo.kl", VERMILLION),
    )
    for i, (name, key, colour) in enumerate(small):
        axes = figure.add_subplot(grid[i, 1], sharex=large)
        _draw_series(axes, steps, column(rows, key), colour)
        dress(axes, name)
        axes.yaxis.set_major_locator(MaxNLocator(4))
        if i < 2:
            axes.tick_params(labelbottom=False)
    for axes in (large, figure.axes[-1]):
        axes.set_xlabel("environment steps", color=INK, size=9)
    if title:
        title = shortened(title, 12, 0.98 * figure.get_figwidth())
        figure.suptitle(title, x=0.01, ha="left", size=12, color=INK)
    figure.savefig(path, dpi=dpi)


def outcomes_figure(
    rows: Sequence[Row], validated: Sequence[Row] = (), size: tuple[float, float] = (5.2, 3.7)
) -> Figure:
    """The large panel of ``save_curves`` alone, ``size`` inches; ``rows`` are one or more."""
    figure, axes, steps = _panel(rows, size)
    _draw_outcomes(axes, steps, rows)
    _draw_phases(axes, steps, rows)
    _draw_validated(axes, validated)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    return figure


def series_figure(
    rows: Sequence[Row],
    key: str,
    name: str,
    colour: str,
    size: tuple[float, float] = (4.2, 2.3),
) -> Figure:
    """One small panel, called ``name``, of the numbers under the dotted ``key`` of ``rows``."""
    figure, axes, steps = _panel(rows, size)
    _draw_series(axes, steps, column(rows, key), colour)
    dress(axes, name)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.xaxis.set_major_locator(MaxNLocator(5))
    return figure


def _panel(
    rows: Sequence[Row], size: tuple[float, float]
) -> tuple[Figure, Axes, NDArray[np.float64]]:
    figure = Figure(figsize=size, facecolor=PAPER, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set_xlabel("environment steps", color=INK, size=9)
    return figure, axes, _steps_of(rows)


def _steps_of(rows: Sequence[Row]) -> NDArray[np.float64]:
    """Environment steps at each row (n,); their numbers where no row has any."""
    steps = column(rows, "steps")
    return steps if np.isfinite(steps).any() else np.arange(len(rows), dtype=np.float64)


def _draw_outcomes(axes: Axes, steps: NDArray[np.float64], rows: Sequence[Row]) -> None:
    ends: list[tuple[float, str, str]] = []
    for key, colour in OUTCOME.items():
        rates = 100 * column(rows, f"episodes.{key}")
        last = _draw_series(axes, steps, rates, colour, width=2.2)
        if last is not None:
            ends.append((last, f"{OUTCOME_WORD[key]} {last:.0f} %", colour))
    dress(axes, "how episodes end")
    axes.set(ylim=(0, 100))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    heights = spread([end for end, _, _ in ends], gap=5.5, low=1.5, high=98.5)
    for height, (_, words, colour) in zip(heights, ends, strict=True):
        axes.annotate(
            words,
            (1.0, height),
            xycoords=("axes fraction", "data"),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            color=colour,
            size=10,
            weight="bold",
            annotation_clip=False,
        )


def _draw_phases(axes: Axes, steps: NDArray[np.float64], rows: Sequence[Row]) -> None:
    """A dotted line and a word where the phase of a run with a teacher changes."""
    said = (row.get("phase") for row in rows)
    phases = [phase if isinstance(phase, str) else None for phase in said]
    if len(set(phases)) == 1:
        return
    room, line, last = _WORD * (steps[-1] - steps[0]), 0, -math.inf
    for i in range(len(phases)):
        if phases[i] is not None and (i == 0 or phases[i] != phases[i - 1]):
            # A phase that is shorter than its word has the next one a line below.
            line, last = line + 1 if steps[i] - last < room else 0, steps[i]
            if i:
                axes.axvline(steps[i], color=INK, linewidth=0.8, linestyle=":", alpha=0.6)
            axes.annotate(
                str(phases[i]),
                (steps[i], 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(4, -12 - 11 * line),
                textcoords="offset points",
                color=INK,
                size=8,
                alpha=0.8,
            )


def _draw_validated(axes: Axes, curve: Sequence[Row]) -> None:
    if not curve:
        return
    counts = [row["sampled"] for row in curve]
    shares = np.array([100 * each["arrived"] / each["episodes"] for each in counts])
    ends = 100 * np.array([wilson_interval(each["arrived"], each["episodes"]) for each in counts])
    axes.errorbar(
        [row["steps"] for row in curve],
        shares,
        yerr=np.maximum(0.0, np.stack([shares - ends[:, 0], ends[:, 1] - shares])),
        fmt="o",
        markersize=3.5,
        color=INK,
        elinewidth=0.9,
        label=f"validated, {counts[-1]['episodes']} episodes each",
    )
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.2,
        frameon=False,
        fontsize=8,
        labelcolor=INK,
    )


def _draw_series(
    axes: Axes,
    steps: NDArray[np.float64],
    values: NDArray[np.float64],
    colour: str,
    width: float = 1.7,
) -> float | None:
    """Raw faint, smoothed strong; returns the last smoothed value."""
    known = np.isfinite(values) & np.isfinite(steps)
    if not known.any():
        return None
    mean = smooth(values[known])
    axes.plot(steps[known], values[known], color=colour, alpha=0.22, linewidth=0.8)
    axes.plot(steps[known], mean, color=colour, linewidth=width, solid_capstyle="round")
    if known.sum() == 1:
        axes.plot(steps[known], mean, color=colour, marker="o", markersize=4)
    return float(mean[-1])


def spread(heights: Sequence[float], gap: float, low: float, high: float) -> list[float]:
    """``heights`` moved apart so that labels at least ``gap`` apart stay between the bounds."""
    order = sorted(range(len(heights)), key=lambda i: heights[i])
    placed = [min(max(heights[i], low), high) for i in order]
    for i in range(1, len(placed)):
        placed[i] = max(placed[i], placed[i - 1] + gap)
    for i in reversed(range(len(placed))):
        ceiling = high if i == len(placed) - 1 else placed[i + 1] - gap
        placed[i] = min(placed[i], ceiling)
    result = [0.0] * len(heights)
    for i, height in zip(order, placed, strict=True):
        result[i] = height
    return result


def dress(axes: Axes, name: str) -> None:
    """A panel as all curves have it: title on the left, quiet axes, steps with their unit."""
    axes.set_title(name, loc="left", size=10, color=INK, pad=5)
    quiet(axes)
    axes.xaxis.set_major_formatter(FuncFormatter(_steps_label))
    axes.margins(x=0.01)


def _steps_label(value: float, _: int | None = None) -> str:
    for size, unit in ((1e6, " M"), (1e3, " k")):
        if abs(value) >= size:
            return f"{value / size:g}{unit}"
    return f"{value:g}"
