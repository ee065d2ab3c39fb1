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
    """``say_origin`` of each policy, once; temperatures play no role where it is ``greedy``."""
    for name, origin, temperature in dict.fromkeys(
        (each.name, each.origin, 1.0 if greedy else each.temperature) for each in sources
    ):
        say_origin(name, origin, temperature)


def say_origin(name: str, origin: str, temperature: float = 1.0) -> None:
    """Say where a policy comes from, and what it is sampled at unless that is 1."""
    said = [origin] if origin else []
    if temperature != 1.0:
        said.append(f"sampled at temperature {temperature:g}")
    if said:
        print(f"{name}: {', '.join(said)}", file=sys.stderr)
