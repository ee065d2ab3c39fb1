"""Driving episodes with a bar: what may be asked for, and words for who stops it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lndrl.cli.again import same_command
from lndrl.cli.signals import telling
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark import Cell, Plan
    from lndrl.navigation import EpisodeRecord


def check_episodes(episodes: int, seed: int, workers: int | None) -> None:
    """Raise UserError for options that no episodes can be driven with."""
    if episodes < 1:
        raise UserError(f"--episodes {episodes}: must be 1 or more")
    if seed < 0:
        raise UserError(f"--seed {seed}: must be 0 or more")
    if workers is not None and workers < 0:
        raise UserError(f"--workers {workers}: must be 0 (in this process) or more")


@contextmanager
def arrivals_bar(episodes: int, title: str) -> Iterator[Callable[[EpisodeRecord], None]]:
    """A bar over ``episodes``; yields what is told each record, and counts who has arrived."""
    from lndrl.view.progress import progress_bar

    arrived = 0
    with progress_bar(episodes, title, "episodes") as advance:

        def note(record: EpisodeRecord) -> None:
            nonlocal arrived
            arrived += record.outcome == "arrived"
            advance(1, f"{arrived} arrived")

        yield note


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
