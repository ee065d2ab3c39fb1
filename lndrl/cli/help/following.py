"""The line that a command ends with: what may come next."""

from __future__ import annotations

import shlex

import typer


def say_next(*words: object, then: str = "") -> None:
    """Print ``next:`` and the command line of ``words``, after it what that does.

    Words are quoted as a shell wants them; without any, ``then`` is a sentence.
    Never to be called where JSON was asked for: that is for programs.
    """
    line = shlex.join(str(word) for word in words)
    typer.echo("next: " + "  # ".join(part for part in (line, then) if part))
