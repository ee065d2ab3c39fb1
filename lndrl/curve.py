"""The validated curve of a run: its rows, what counts as better, and when it has stopped rising.

A row is what ``metrics.jsonl`` holds of one validated version (docs/training.md, "Validation").
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lndrl.config import RunConfig
from lndrl.models import effective
from lndrl.transport.messages import COUNTS

Row = Mapping[str, Any]


def conditions(config: RunConfig) -> str:
    """Twelve hex digits of all that decides what validation episodes are.

    Arrivals under other conditions say nothing about which policy is better.
    """
    sections = (config.scenario, config.world, config.localization, config.task)
    facts = [*map(effective, sections), config.learner.validation_episodes]
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:12]


def score(row: Row, before: Row | None) -> float:
    """Share of sampled arrivals of a version and of the one validated ``before`` it, together.

    The best of many noisy rates is mostly a lucky one. Two neighbours are nearly the same policy,
    so both say something about the later one, and luck needs to strike twice.
    """
    both = [each["sampled"] for each in (row, before) if each is not None]
    return float(sum(one["arrived"] for one in both) / sum(one["episodes"] for one in both))


@dataclass(frozen=True)
class Standstill:
    """A curve that has not risen for ``patience`` steps: what finishes a run before its steps.

    ``best``: the step of the highest ``score``. ``since``: from which step on it was waited for a
    higher one, in vain up to ``until``, the step of a validated version.
    """

    patience: int
    best: int
    score: float
    since: int
    until: int

    def __str__(self) -> str:
        """A sentence without an end."""
        return (
            f"validated arrivals have not risen from step {self.since:,} to {self.until:,}, the "
            f"most are {self.score:.3f} at step {self.best:,} (learner.patience {self.patience:,})"
        )


def standstill(curve: Iterable[Row], config: RunConfig, under: str) -> Standstill | None:
    """Where ``curve`` first stood still for ``learner.patience`` steps; None where it never did.

    What rises is ``score``, strictly, over the versions in their order; rows of other conditions
    than ``under`` do not count. The steps are those between validated versions, so nothing is
    concluded while nobody validates. They count from the best version, or from the end of imitation
    where that came later. More rows at its end never undo it.
    """
    patience = config.learner.patience
    if not patience:
        return None
    imitated = config.imitation.steps if config.ppo.teacher is not None else 0
    best, most, before = 0, -1.0, None
    for row in sorted((r for r in curve if r["under"] == under), key=lambda r: int(r["version"])):
        steps, share = int(row["steps"]), score(row, before)
        before = row
        since = max(best, imitated)
        if share > most:
            best, most = steps, share
        elif steps - since >= patience:
            return Standstill(patience, best, most, since, steps)
    return None


def read_curve(path: Path) -> list[dict[str, Any]]:
    """The rows of validation in a ``metrics.jsonl``, oldest first; damaged ones are left out."""
    try:
        with path.open("rb") as file:
            return curve_in(file)
    except OSError:
        return []  # the recorder has said so


def curve_in(lines: Iterable[bytes]) -> list[dict[str, Any]]:
    """The rows of validation among the ``lines`` of a ``metrics.jsonl``, see ``read_curve``."""
    found = [_row_in(line) for line in lines if b'"validation"' in line]
    return [row for row in found if row is not None]


def _row_in(line: bytes) -> dict[str, Any] | None:
    try:
        row = json.loads(line)["validation"]
        checked = (row["version"], row["steps"], row["unix"], row["under"])
        counts = [row[kind][name] for kind in ("sampled", "greedy") for name in COUNTS]
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    if not all(type(number) is int and 0 <= number < 2**53 for number in (*checked[:2], *counts)):
        return None
    ended = ("arrived", "collided", "lost", "timeout")
    fits = all(
        0 < row[kind]["episodes"] >= sum(row[kind][name] for name in ended)
        for kind in ("sampled", "greedy")
    )
    return row if fits else None
