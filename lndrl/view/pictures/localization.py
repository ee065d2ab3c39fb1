"""The picture of a localization report: every drive's error, and one drive over time."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from PIL import Image

from lndrl.view.palette import BLUE, GREEN, INK, ORANGE, PAPER, PINK, SKY, SLATE, VERMILLION
from lndrl.view.pictures.axes import quiet
from lndrl.view.pictures.fitting import shortened
from lndrl.wording import counted

if TYPE_CHECKING:
    from lndrl.evaluation.localization import Outcome, Report

_COLOURS = (VERMILLION, BLUE, GREEN, PINK, ORANGE, SKY, SLATE)
_LOWEST, _HIGHEST = 0.001, 40.0  # m
_SHADES = 96
_TICKS = (0.001, 0.01, 0.1, 1.0, 10.0)


def save_localization(report: Report, path: Path | str, dpi: int = 100) -> None:
    """Write the picture: per scenario a dot for every drive, below it one drive over time.

    The drive is the one in the largest crowd on which the first setting's error is the median.
    Raises OSError where ``path`` cannot be written.
    """
    scenarios = [scenario.name for scenario in report.plan.scenarios]
    labels = list(report.plan.settings)
    width = max(7.5, 2.7 * len(scenarios) + 0.8)
    figure = Figure(figsize=(width, 5.6), facecolor=PAPER, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(2, len(scenarios), squeeze=False, sharey=True)
    for column, scenario in enumerate(scenarios):
        outcomes = [o for o in report.outcomes if o.scenario == scenario]
        _draw_drives(grid[0, column], outcomes, labels, report.plan.pedestrians)
        chosen = _typical(outcomes, labels[0], report.plan.pedestrians[-1])
        _draw_course(grid[1, column], chosen, labels, report)
        name = shortened(scenario, 11, 0.9 * width / len(scenarios) - 0.2, "bold")
        grid[0, column].set_title(name, loc="left", size=11, color=INK, weight="bold")
    grid[0, 0].set_ylabel("position RMSE of a drive (m)", size=9, color=INK)
    grid[1, 0].set_ylabel("position error (m)", size=9, color=INK)
    handles, names = grid[1, 0].get_legend_handles_labels()
    figure.legend(
        handles, names, loc="outside upper right", ncols=len(names), frameon=False, fontsize=10
    )
    drawn = BytesIO()
    figure.savefig(drawn, format="png", dpi=dpi)
    # Hundreds of dots and lines: as true colour the picture is three times as large.
    Image.open(drawn).convert("RGB").quantize(_SHADES).save(path, format="png", optimize=True)


def _draw_drives(
    axes: Axes, outcomes: Sequence[Outcome], labels: Sequence[str], crowds: Sequence[int]
) -> None:
    """Dots beside each other by crowd and setting, hollow where lost; a bar at the median."""
    slot = 0.8 / len(labels)
    for place, people in enumerate(crowds):
        for i, label in enumerate(labels):
            chosen = [o for o in outcomes if o.setting == label and o.pedestrians == people]
            values = np.clip([o.position_rmse for o in chosen], _LOWEST, _HIGHEST)
            middle = place - 0.4 + (i + 0.5) * slot
            spread = np.linspace(-0.32, 0.32, len(values)) * slot
            colour = _COLOURS[i % len(_COLOURS)]
            faces = ["none" if o.lost else colour for o in chosen]
            axes.scatter(
                middle + spread, values, s=13, c=faces, edgecolors=colour, linewidths=0.9, zorder=3
            )
            axes.plot(
                [middle - 0.42 * slot, middle + 0.42 * slot],
                [np.median(values)] * 2,
                color=INK,
                linewidth=1.6,
                zorder=4,
            )
    axes.set_xticks(range(len(crowds)), [f"{people}" for people in crowds])
    axes.set_xlabel("people (hollow: lost)", size=8.5, color=INK)
    axes.set_xlim(-0.5, len(crowds) - 0.5)
    _dress(axes)


def _typical(outcomes: Sequence[Outcome], label: str, people: int) -> list[Outcome]:
    """The outcomes of all settings on the drive that is the median for ``label``."""
    crowd = [o for o in outcomes if o.pedestrians == people]
    ordered = sorted((o for o in crowd if o.setting == label), key=lambda o: o.position_rmse)
    seed = ordered[len(ordered) // 2].seed
    return [o for o in crowd if o.seed == seed]


def _draw_course(
    axes: Axes, outcomes: Sequence[Outcome], labels: Sequence[str], report: Report
) -> None:
    tick = report.plan.world.tick
    for outcome in outcomes:
        time = tick * (1 + np.arange(len(outcome.errors)))
        colour = _COLOURS[labels.index(outcome.setting) % len(_COLOURS)]
        shown = np.clip(outcome.errors, _LOWEST, _HIGHEST)
        axes.plot(time, shown, color=colour, linewidth=1.2, label=outcome.setting)
    axes.axhline(report.plan.task.lost_distance, color=SLATE, linewidth=0.9, linestyle="--")
    first = outcomes[0]
    crowd = counted(first.pedestrians, "person", "people")
    axes.set_xlabel(
        f"s (drive {first.seed}, {crowd}; dashed: lost)",
        size=8.5,
        color=INK,
    )
    _dress(axes)


def _dress(axes: Axes) -> None:
    axes.set_yscale("log")
    axes.set_ylim(_LOWEST, _HIGHEST)
    axes.yaxis.set_major_locator(FixedLocator(_TICKS))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    quiet(axes)
