"""Notes on stderr: what a user should know and nobody has to act on."""

from __future__ import annotations

import sys
from collections.abc import Iterable


def say_notes(notes: Iterable[str]) -> None:
    """Print each different note once, on stderr: stdout may be read by a program."""
    for note in dict.fromkeys(notes):
        print(f"note: {note}", file=sys.stderr)
