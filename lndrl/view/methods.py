"""How far the training of several methods is, a line per method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TextIO

from lndrl.view.progress import StatusLine
from lndrl.view.text import number, percent

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark import MethodsFolder
    from lndrl.evaluation.sweep import Progress

LINE_EVERY = 60.0
"""s between lines where there is no terminal; a method takes an hour."""


def method_line(name: str, steps: int, row: Mapping[str, Any], early: bool = False) -> str:
    """A method that is to take ``steps`` steps, by the newest ``row`` of its metrics.

    Arrivals are those of the newest episodes; steps/s those of the last minute of training.
    ``early``: it is finished, as its validated arrivals no longer rose.
    """
    done = f"{name}: {row.get('steps', 0):,} of {steps:,} steps{' (no longer rose)' * early}"
    if not row:
        return done
    rate, arrived = row["time"]["steps_per_second"], row["episodes"]["arrived"]
    return f"{done}, {number(rate)} steps/s, {percent(arrived)} arrived of late"


class MethodsDisplay(StatusLine):
    """One line that changes, on a terminal; else a line a minute. Writes to stderr."""

    def __init__(self, folder: MethodsFolder, stream: TextIO | None = None) -> None:
        super().__init__(LINE_EVERY, at_once=False, stream=stream)
        self._folder = folder
        self._seen: tuple[str, int] | None = None
        self._words = ""

    def show(self, progress: Progress) -> None:
        """The line that changes."""
        for job, steps in progress.active:
            if self._seen != (job.run.name, steps):
                self._seen = job.run.name, steps
                goal = job.run.config.learner.total_steps
                self._words = method_line(job.run.name, goal, self._folder.newest(job.run))
            self.update(f"{self._words} ({progress.done + 1} of {progress.runs})")
