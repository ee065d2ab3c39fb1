"""Driving what is missing of plans, with a bar, and words for who stops it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lndrl.cli.again import same_command
from lndrl.cli.signals import telling

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark import Cell, Plan
    from lndrl.navigation import EpisodeRecord


def drive_plans(plans: Sequence[Plan], title: str, place: Path, workers: int) -> None:
    """Run ``plans`` by the same ``workers`` processes; ``title`` heads the bar.

    Whoever stops it is told how many episodes are kept in ``place``, and how to go on.
    """
    from lndrl.evaluation.benchmark.run import run_plans
    from lndrl.view.progress import progress_bar

    left = sum(plan.left() for plan in plans)
    ended = 0

    def words() -> str:
        return (
            f"{ended} of {left} missing episodes have ended and are kept in {place}; "
            f"go on with: {same_command()}"
        )

    with telling(words), progress_bar(left, title, "episodes") as advance:

        def note(cell: Cell, record: EpisodeRecord) -> None:
            nonlocal ended
            ended += 1
            advance(1, f"{cell.contender.name} on {cell.scenario}: {record.outcome}")

        run_plans(plans, workers, note)
