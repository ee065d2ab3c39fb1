"""``lndrl version``: what is installed, for bug reports."""

from __future__ import annotations

import json as json_format
import platform
from importlib import metadata
from typing import Annotated

import typer

from lndrl.cli.help import say_next
from lndrl.version import VERSION

# Read from the installed packages' names, because importing torch takes seconds.
_LIBRARIES = ("torch", "eclipse-zenoh", "numba", "numpy", "pymunk")


def version(
    json: Annotated[bool, typer.Option("--json", help="As one JSON object.")] = False,
) -> None:
    """Say which versions are installed."""
    found = versions()
    if json:
        typer.echo(json_format.dumps(found))
    else:
        width = max(map(len, found))
        typer.echo("\n".join(f"{name:<{width}}  {number}" for name, number in found.items()))
        say_next("lndrl", "version", "--json", then="for a report of a bug")


def versions() -> dict[str, str]:
    """The program's version, Python's, and those of the libraries that decide what it does."""
    found = {"lndrl": VERSION, "python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "missing"
    return found
