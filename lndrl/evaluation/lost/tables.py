"""Why a planner gets lost, as tables for a terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from rich.table import Table

from lndrl.evaluation.hazard import Hazard
from lndrl.evaluation.lost.record import AHEAD
from lndrl.evaluation.lost.report import LostReport
from lndrl.evaluation.lost.summary import (
    BEFORE,
    FIGURES,
    HEADING_STEPS,
    JUMP_SHARE,
    RISKS,
    TURNED_STEPS,
    WHOLE,
    Typical,
)
from lndrl.wilson import wilson_interval
from lndrl.wording import counted

RISK_NAMES = {
    "turned": f"turned in the last {TURNED_STEPS} steps (rad)",
    "heading": f"heading off {HEADING_STEPS} steps before (rad)",
    "echoes": "share of beams with an echo",
    "people": f"people ahead, within {AHEAD:g} m",
    "step": "control steps since the start",
}
_DIGITS = (3, 3, 0, 4, 4, 2, 2, 3)
"""Behind the point, of ``FIGURES``."""


def lost_tables(report: LostReport) -> list[Table]:
    """How often and how, what came before, and the hazard by what the robot did and saw."""
    tables = [_places(report)]
    if report.losses:
        tables += [_before(report)]
    return [*tables, _risks(report)]


def summary_lines(report: LostReport) -> list[str]:
    """What the tables come to, in sentences."""
    hazard, limits = report.hazard, report.limits
    low, high = hazard.interval
    steps, all_of_them = (
        counted(hazard.steps, "control step"),
        counted(len(report.traces), "episode"),
    )
    if not report.losses:
        return [
            f"none of {all_of_them} was lost in {steps}: the hazard lies between 0 and "
            f"{high:.2f} per 1,000 (95 %)"
        ]
    jumps, drifts = report.kinds["jump"], report.kinds["drift"]
    least, most = (100.0 * bound for bound in wilson_interval(jumps, jumps + drifts))
    passed = ", ".join(f"{_LIMITS[name]} {n}" for name, n in report.limits_passed.items() if n)
    return [
        f"{len(report.losses)} of {all_of_them} were lost in {steps}: {hazard.value:.2f} per 1,000 "
        f"({low:.2f} to {high:.2f})",
        f"jumps {jumps} ({least:.0f} to {most:.0f} %), drifts {drifts}; who jumped was less than "
        f"{JUMP_SHARE * limits.distance:g} m and {JUMP_SHARE * limits.angle:.2f} rad off one "
        "control step before",
        f"limits passed ({limits.distance:g} m, {limits.angle:.2f} rad): {passed}",
        f"errors of heading told of {report.foretold:.1f} losses; {len(report.losses)} came",
    ]


_LIMITS = {
    "distance": "distance alone",
    "angle": "angle alone",
    "both": "both",
    "delay": "neither but for the delay",
}


def _places(report: LostReport) -> Table:
    table = _table(
        f"{report.planner} on {report.world}, seed {report.seed}",
        ("scenario", "episodes", "lost", "jumps", "drifts", "steps", "per 1,000 steps", "95 %"),
    )
    for name in report.scenarios:
        losses = report.losses_in(name)
        jumps = sum(loss.kind == "jump" for loss in losses)
        hazard = report.hazard_in(name)
        episodes = report.episodes_in(name).total()
        kinds = (str(jumps), str(len(losses) - jumps))
        table.add_row(name, str(episodes), str(len(losses)), *kinds, *_hazard(hazard))
    if len(report.scenarios) > 1:
        table.add_section()
        kinds = (str(report.kinds["jump"]), str(report.kinds["drift"]))
        counts = (str(len(report.traces)), str(len(report.losses)))
        table.add_row("all", *counts, *kinds, *_hazard(report.hazard))
    return table


def _before(report: LostReport) -> Table:
    table = _table(
        f"before the loss: medians over {counted(len(report.losses), 'lost episode')}",
        (
            "step", "off (m)", "off (rad)", "particles", "slow", "fast", "fast/slow",
            "injected", "2nd cluster",
        ),
    )  # fmt: skip
    for step, each in enumerate(report.typical_before):
        table.add_row("loss" if step == BEFORE else f"{step - BEFORE}", *_figures(each))
    usual, _ = report.usual
    table.add_section()
    table.add_row("not lost", *_figures(usual))
    return table


def _figures(each: Sequence[Typical]) -> list[str]:
    found = []
    for name, figure, digits in zip(FIGURES, each, _DIGITS, strict=True):
        if math.isnan(figure.median):
            found.append("–")
        elif name == "injected":
            found.append(f"{100.0 * figure.mean:.1f} %")  # a median of 0 and 1 tells nothing
        else:
            found.append(f"{figure.median:.{digits}f}")
    return found


def _risks(report: LostReport) -> Table:
    head = ("hazard by", "", "steps", "lost", "per 1,000 steps", "95 %")
    table = _table("what the risk depends on", head)
    for risk in RISKS:
        for i, hazard in enumerate(report.hazards(risk)):
            steps, rate, interval = _hazard(hazard)
            label = "" if i else RISK_NAMES[risk]
            table.add_row(label, bin_names(risk)[i], steps, str(hazard.count), rate, interval)
        table.add_section()
    return table


def bin_names(risk: str) -> list[str]:
    """What the bins of one of ``RISKS`` are called."""
    edges = RISKS[risk]
    if risk in WHOLE:
        pairs = zip((0, *edges[:-1]), edges, strict=True)
        whole = [f"{low}" if high == low + 1 else f"{low}–{int(high) - 1}" for low, high in pairs]
        return [*whole, f"{edges[-1]} or more"]
    between = [f"{low:g}–{high:g}" for low, high in pairwise(edges)]
    return [f"< {edges[0]:g}", *between, f"≥ {edges[-1]:g}"]


def _hazard(hazard: Hazard) -> tuple[str, str, str]:
    if not hazard.steps:
        return "0", "–", "–"
    low, high = hazard.interval
    return f"{hazard.steps:,}", f"{hazard.value:.2f}", f"{low:.2f}–{high:.2f}"


def _table(title: str, head: Sequence[str]) -> Table:
    table = Table(title=title, title_justify="left")
    for i, name in enumerate(head):
        table.add_column(name, justify="right" if i else "left")
    return table
