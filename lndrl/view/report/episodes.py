"""Chapters about driven episodes: how they end, paths, why one gets lost, the network, failures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lndrl.view.palette import OUTCOME_WORD, PAPER
from lndrl.view.pictures.activations import Activations, activations_figure
from lndrl.view.pictures.lost import lost_figure
from lndrl.view.pictures.trajectories import trajectories_figure
from lndrl.view.pictures.worst import Panel, draw_panel
from lndrl.view.report.embedded import drawing
from lndrl.view.report.parts import (
    OUTCOME_TONE,
    Folded,
    Gallery,
    Part,
    Picture,
    Section,
    Table,
    Text,
    Tile,
    Tiles,
)
from lndrl.view.text import number, percent

if TYPE_CHECKING:
    from lndrl.evaluation import EvaluationResult
    from lndrl.evaluation.benchmark import Drive
    from lndrl.evaluation.filmed import Look
    from lndrl.evaluation.hazard import Hazard
    from lndrl.evaluation.lost import LostReport
    from lndrl.scenario import Scenario

_RATES = {"arrived": "arrival", "collided": "collision", "lost": "lost", "timeout": "stuck"}
_SIDE = 3.2  # inches of a failure's picture
_LINES = "solid line: where the robot was; dashed: where it believed to be"


def outcomes_section(result: EvaluationResult, said: str) -> Section:
    """How the driven episodes ended, and the nine metrics; ``said`` tells which these are."""
    from lndrl.evaluation.tables import RATES, SPREADS

    metrics = result.metrics
    tiles = []
    for outcome, name in _RATES.items():
        rate = getattr(metrics, name)
        low, high = (100 * end for end in rate.interval)
        note = f"{rate.count} of {rate.episodes}; {low:.0f}–{high:.0f} %"
        tiles.append(Tile(OUTCOME_WORD[outcome], percent(rate.value), note, OUTCOME_TONE[outcome]))
    rows = []
    for name, (_, words) in RATES.items():
        rate = getattr(metrics, name)
        low, high = rate.interval
        cells = (f"{rate.value:.3f}", f"{low:.3f}–{high:.3f}", f"{rate.count} of {rate.episodes}")
        rows.append((words, *cells))
    for name, (_, words) in SPREADS.items():
        spread = getattr(metrics, name)
        ends = spread.interval
        interval = "–" if ends is None else f"{max(ends[0], 0.0):.3f}–{ends[1]:.3f}"
        rows.append((words, number(spread.mean), interval, str(spread.episodes)))
    table = Table(
        "The paper's nine metrics; reach time and distance are of arrived episodes alone.",
        ("metric", "mean", "95 % interval", "episodes"),
        rows,
    )
    return Section("episodes", "Episodes driven", [Text(said), Tiles(tiles), table])


def trajectories_section(drives: Sequence[Drive]) -> Section:
    """A picture of each of ``drives``: the way, and how far off the belief was over time."""
    pictures = [_trajectory(drive) for drive in drives]
    words = f"The first episodes, whatever became of them; {_LINES}."
    return Section("trajectories", "Trajectories", [Text(words), Gallery(pictures, 420)])


def _trajectory(drive: Drive) -> Picture:
    error = drive.position_error
    alt = (
        f"Map of {drive.scenario} with the way of episode {drive.episode}, {drive.reason}, and "
        f"below it the errors over time: position error {float(error.mean()):.2f} m on average, "
        f"{float(error.max()):.2f} m at most; angle error at most "
        f"{float(np.max(drive.angle_error)):.2f} rad."
    )
    figure = trajectories_figure([drive])
    caption = f"Episode {drive.episode}: {drive.reason}"
    ended = drive.record.outcome
    return drawing(
        figure, alt, caption, dpi=130, badge=OUTCOME_WORD[ended], tone=OUTCOME_TONE[ended]
    )


def lost_section(report: LostReport, scenario: Scenario) -> Section:
    """Why, when and where it gets lost."""
    from lndrl.evaluation.lost import RISK_NAMES, RISKS, bin_names, summary_lines

    lines = summary_lines(report)
    parts: list[Part | Folded] = [Text(_sentence(line)) for line in lines]
    alt = (
        f"Map of {scenario.name} with the places where it was lost, and charts of the hazard by "
        f"turning, echoes, people and time: {lines[0]}."
    )
    caption = "Where it was lost, and what the hazard depends on; a table below says the same."
    parts.append(drawing(lost_figure(report, [scenario]), alt, caption, wide=True))
    if report.losses:
        parts.append(Folded("Every loss", [_losses(report)]))
    rows = [
        (f"{RISK_NAMES[risk]}: {name}", f"{hazard.steps:,}", str(hazard.count), *_hazard(hazard))
        for risk in RISKS
        for name, hazard in zip(bin_names(risk), report.hazards(risk), strict=True)
    ]
    head = ("what", "control steps", "lost", "per 1,000 steps", "95 %")
    table = Table("The hazard of getting lost by what the robot did and saw.", head, rows)
    return Section("lost", "Why it gets lost", [*parts, Folded("The hazards as a table", [table])])


def _losses(report: LostReport) -> Table:
    rows = [
        (
            f"episode {loss.episode}",
            f"a {loss.kind}",
            f"{loss.x:.1f}, {loss.y:.1f}",
            f"{loss.x_estimated:.1f}, {loss.y_estimated:.1f}",
            f"{np.hypot(loss.x - loss.x_estimated, loss.y - loss.y_estimated):.1f}",
        )
        for loss in report.losses
    ]
    head = ("episode", "how", "was at (m)", "thought to be at (m)", "off (m)")
    return Table("Every lost episode.", head, rows, words=frozenset({0, 1}))


def _hazard(hazard: Hazard) -> tuple[str, str]:
    if not hazard.steps:
        return "–", "–"
    low, high = hazard.interval
    return f"{hazard.value:.2f}", f"{low:.2f}–{high:.2f}"


def activations_section(look: Look | None, blind: str) -> Section:
    """What the first laser layer answers halfway through an episode, or why that is not shown."""
    title = "What the network sees"
    if look is None:
        return Section("activations", title, [Text(f"Not shown: {blind}.")])
    values = look.layer.values
    mean = values.mean(axis=0)
    shown = Activations(look.snapshot, look.scans, values, look.layer.beams)
    strongest = float(shown.angles(look.layer.beams)[int(mean.argmax())])
    idle = int((values.max(axis=1) <= 0.0).sum())
    side = "left" if strongest > 0 else "right"
    alt = (
        f"The scene around the robot, its scan, and the answer of the first laser layer: "
        f"{values.shape[0]} channels at {values.shape[1]} positions, strongest on average "
        f"{abs(strongest):.0f} degrees to the {side}; {idle} channels do not answer."
    )
    moment = f"Episode {look.episode}, control step {look.step} of {look.steps}"
    caption = (
        f"{moment}: the first laser layer beside scene and scan, as in the paper's Fig. 6. "
        f"{idle} of {values.shape[0]} channels do not answer here."
    )
    figure = activations_figure(shown, moment)
    return Section("activations", title, [drawing(figure, alt, caption, wide=True)])


def gallery_section(
    panels: Sequence[Panel], words: str, parts: Sequence[Part | Folded] = ()
) -> Section:
    """The worst episodes, worst first, each with the reason it ended; ``parts`` come after."""
    pictures = [_panel(panel, place) for place, panel in enumerate(panels, 1)]
    gallery: list[Part | Folded] = [Gallery(pictures, 270)] if pictures else []
    legend = f"; {_LINES}, the ring its start, the star its goal; people are pink" if panels else ""
    return Section("failures", "Failure gallery", [Text(f"{words}{legend}."), *gallery, *parts])


def _panel(panel: Panel, place: int) -> Picture:
    drive = panel.drive
    figure = Figure(figsize=(_SIDE, _SIDE), facecolor=PAPER)
    FigureCanvasAgg(figure)
    draw_panel(panel, figure.add_axes((0.0, 0.0, 1.0, 1.0)))
    where = f"{drive.scenario}, episode {drive.episode}"
    again = f" ({panel.difference})" if panel.difference else ""
    alt = (
        f"Map around the way of {where}: {drive.reason}; it drove {drive.record.distance:.1f} m, "
        f"its belief was {drive.record.position_error:.2f} m off on average."
    )
    caption = f"{place}. {where}: {drive.reason}{again}"
    ended = drive.record.outcome
    return drawing(
        figure, alt, caption, dpi=190, badge=OUTCOME_WORD[ended], tone=OUTCOME_TONE[ended]
    )


def _sentence(line: str) -> str:
    return f"{line[:1].upper()}{line[1:]}."
