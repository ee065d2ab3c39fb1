"""The command line that was called, as it can be called again."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Sequence
from contextvars import ContextVar
from pathlib import Path

_given: ContextVar[tuple[str, ...]] = ContextVar("given", default=())


def remember(arguments: Sequence[str]) -> None:
    """Note what was called; ``arguments`` as they were given."""
    _given.set(tuple(arguments))


def arguments_given() -> tuple[str, ...]:
    """What ``remember`` was told last."""
    return _given.get()


def same_command() -> str:
    """The command line that was called."""
    return shlex.join([*_program(), *_given.get()])


def resuming_command(run: str) -> str:
    """The command line of ``lndrl train`` or ``learner`` as it goes on with ``run``.

    A checkpoint that was chosen is left out: the newest is what goes on.
    """
    given, kept = list(_given.get()), []
    while given:
        argument = given.pop(0)
        if argument == "--checkpoint":
            del given[:1]
        elif not argument.startswith("--checkpoint="):
            kept.append(argument)
    if not any(argument.partition("=")[0] in ("--run", "--run-name") for argument in kept):
        kept += ["--run", run]
    if "--resume" not in kept:
        kept.append("--resume")
    return shlex.join([*_program(), *kept])


def _program() -> list[str]:
    """How this program was started: by its name, its path, or as Python's module."""
    called = Path(sys.argv[0] if sys.argv else "")
    if (called.parent.name, called.name) == ("lndrl", "__main__.py"):
        return [sys.executable, "-m", "lndrl"]
    found = shutil.which("lndrl")
    is_script = called.name == "lndrl" and called.exists()
    if is_script and not (found and called.samefile(found)):
        return [str(called)]
    return ["lndrl"]
