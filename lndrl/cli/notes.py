"""Notes on stderr: what a user should know and nobody has to act on."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lndrl.planners import PlannerSource


def say_notes(notes: Iterable[str]) -> None:
    """Print each different note once, on stderr: stdout may be read by a program."""
    for note in dict.fromkeys(notes):
        print(f"note: {note}", file=sys.stderr)


def say_origins(sources: Iterable[PlannerSource], greedy: bool = False) -> None:
    """Say of each policy where it comes from, and what it is sampled at unless that is 1."""
    for line in dict.fromkeys(_origin(each, greedy) for each in sources):
        if line:
            print(line, file=sys.stderr)


def _origin(source: PlannerSource, greedy: bool) -> str:
    said = [source.origin] if source.origin else []
    if source.temperature != 1.0 and not greedy:
        said.append(f"sampled at temperature {source.temperature:g}")
    return f"{source.name}: {', '.join(said)}" if said else ""
