"""Returns as tables for a terminal: by discount, by part, and how the episodes ended."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from rich.table import Table

from lndrl.config import RunConfig
from lndrl.evaluation.estimate import Estimate
from lndrl.evaluation.returns.report import (
    RATES,
    ReturnsReport,
    limited_share,
    mean_parts,
    steps_of,
)
from lndrl.evaluation.tables import RATES as SHORT
from lndrl.evaluation.tables import describe, planner_words

MARK = " *"


def returns_tables(report: ReturnsReport, all_parts: bool = False) -> list[Table]:
    """Returns per discount, how the episodes ended, and the reward's parts at the largest discount,
    or at each where ``all_parts``.

    Planners stand below each other, so that 80 columns hold any number of them.
    """
    return [_by_discount(report), _outcomes(report), _by_part(report, all_parts)]


def _by_discount(report: ReturnsReport) -> Table:
    first = report.planners[0]
    table = Table(
        title=f"Mean discounted return, {describe(first.result, planner=False)}; "
        f"{_reward_words(report.reward, first.config)}",
        title_justify="left",
        caption=_caption(report),
        caption_justify="left",
    )
    table.add_column("discount", justify="right")
    table.add_column("planner", overflow="fold")
    table.add_column("return", justify="right")
    table.add_column("95 % interval", justify="right")
    several = len(report.planners) > 1
    if several:
        table.add_column("Δ", justify="right")
        table.add_column("95 % interval", justify="right")
    figures = _Figures.of(report)
    differences = [report.differences(planner) for planner in report.planners]
    for row, discount in enumerate(report.discounts):
        for planner, found in zip(report.planners, differences, strict=True):
            cells = [f"{discount:g}" if planner is first else "", planner_words(planner.result)]
            cells += figures.estimate(planner.estimates[row])
            if several:
                cells += ["–", ""] if found is None else figures.difference(found[row])
            table.add_row(*cells, end_section=planner is report.planners[-1])
    return table


def _outcomes(report: ReturnsReport) -> Table:
    table = Table(title="How the episodes ended", title_justify="left")
    table.add_column("planner", overflow="fold")
    for name in RATES:
        table.add_column(SHORT[name][0], justify="right")
    table.add_column("steps", justify="right")
    table.add_column("limited steps (%)", justify="right")
    for planner in report.planners:
        rates = [getattr(planner.result.metrics, name) for name in RATES]
        steps = steps_of(planner).mean
        table.add_row(
            planner_words(planner.result),
            *(f"{rate.value:.3f}" for rate in rates),
            "–" if steps is None else f"{steps:.1f}",
            f"{100.0 * limited_share(planner):.2f}",
        )
    return table


def _by_part(report: ReturnsReport, all_parts: bool) -> Table:
    discounts = report.discounts if all_parts else (report.largest,)
    at = "" if all_parts else f" at discount {report.largest:g}"
    table = Table(title=f"What each part of the reward adds{at}", title_justify="left")
    if all_parts:
        table.add_column("discount", justify="right")
    table.add_column("planner", overflow="fold")
    for part in report.planners[0].parts:
        table.add_column(part, justify="right")
    figures = _Figures.of(report)
    for discount in discounts:
        row = report.discounts.index(discount)
        for planner in report.planners:
            parts = mean_parts(planner)[row].values()
            cells = [planner_words(planner.result), *map(figures.number, parts)]
            if all_parts:
                cells.insert(0, f"{discount:g}" if planner is report.planners[0] else "")
            table.add_row(*cells, end_section=planner is report.planners[-1])
    return table


def _reward_words(reward: str, config: RunConfig) -> str:
    """Whose reward it is, and what the learner makes of it."""
    limit, pose = config.ppo.reward_limit, config.task.reward.pose_limit
    words = f"reward of {reward}, × {config.ppo.reward_scale:g}"
    words += "" if limit is None else f", limited to ±{limit:g}"
    return words + ("" if pose is None else f", pose part to ±{pose:g}")


def _caption(report: ReturnsReport) -> str:
    words = []
    if len(report.planners) > 1:
        first = planner_words(report.planners[0].result)
        words.append(f"Δ: above {first} in the same episodes, * where its interval leaves 0 out")
    if any(planner.result.metrics.stuck.count for planner in report.planners):
        words.append("a timeout counts as an end, without the value that a learner adds")
    return "; ".join(words)


@dataclass(frozen=True)
class _Figures:
    """How numbers of a report are written: four digits of the largest return, all others alike."""

    decimals: int

    @classmethod
    def of(cls, report: ReturnsReport) -> _Figures:
        means = [each.mean or 0.0 for planner in report.planners for each in planner.estimates]
        largest = max(map(abs, means))
        return cls(min(max(3 - math.floor(math.log10(largest)), 0), 6) if largest else 2)

    def number(self, value: float) -> str:
        words = f"{abs(value):.{self.decimals}f}"
        return f"−{words}" if value < 0.0 and float(words) else words

    def signed(self, value: float) -> str:
        words = self.number(value)
        return words if words.startswith("−") else f"+{words}"

    def estimate(self, estimate: Estimate) -> list[str]:
        """Mean and interval; of a single episode there is none."""
        return self._cells(estimate, self.number)

    def difference(self, estimate: Estimate) -> list[str]:
        """Mean and interval with their signs, marked where the interval leaves 0 out."""
        mean, interval = self._cells(estimate, self.signed)
        return [f"{mean}{MARK}" if estimate.clear else mean, interval]

    def _cells(self, estimate: Estimate, say: Callable[[float], str]) -> list[str]:
        assert estimate.mean is not None, "there are no reports without episodes"
        interval = estimate.interval
        return [say(estimate.mean), "–" if interval is None else " to ".join(map(say, interval))]
