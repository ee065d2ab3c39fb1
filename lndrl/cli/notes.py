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


def say_origins(sources: Iterable[PlannerSource]) -> None:
    """Say of each policy of a run which of its checkpoints it is, a line each."""
    for line in dict.fromkeys(f"{each.name}: {each.origin}" for each in sources if each.origin):
        print(line, file=sys.stderr)
