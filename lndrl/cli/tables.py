"""Tables on stdout or stderr, for people in a terminal and for pipes."""

from __future__ import annotations

from typing import TextIO

from rich.console import Console
from rich.table import Table


def print_tables(*tables: Table, file: TextIO | None = None) -> None:
    """Print each table to ``file`` (stdout); where no terminal limits it, in its full width."""
    console = Console(file=file, highlight=False)
    for table in tables:
        if not console.is_terminal:
            # Rich would squeeze the table into 80 columns that a pipe does not have.
            needed = console.measure(table, options=console.options.update(width=500)).maximum
            console = Console(file=file, highlight=False, width=max(needed, 80))
        console.print(table)
