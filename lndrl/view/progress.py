"""Long work that says how far it is, and tables, on a terminal and without one."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Self, TextIO

from rich import box
from rich.console import Console
from rich.live import Live
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from lndrl.view.palette import BLUE, GREEN
from lndrl.view.text import MISSING, duration, number, printable

LINE_EVERY = 10.0
"""s between lines where there is no terminal."""

Advance = Callable[..., None]
"""``advance(count=1, note="")``: ``count`` more are done; ``note`` stands beside the bar."""


class StatusLine:
    """A line on stderr that changes, on a terminal; elsewhere one every ``every`` s.

    The first of these comes at once where ``at_once``.
    """

    def __init__(
        self, every: float = LINE_EVERY, at_once: bool = True, stream: TextIO | None = None
    ) -> None:
        self._console = Console(file=stream or sys.stderr, highlight=False)
        drawn = self._console.is_terminal and not self._console.is_dumb_terminal
        self._live = Live(console=self._console, transient=True) if drawn else None
        self._every = every
        self._last = time.monotonic() - (every if at_once else 0.0)

    def __enter__(self) -> Self:
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def say(self, words: str) -> None:
        """A line that stays."""
        stamped = f"{time.strftime('%H:%M:%S')} {printable(words)}"
        self._console.print(Text(stamped), soft_wrap=True)

    def update(self, words: str) -> None:
        """The line that changes."""
        if self._live:
            self._live.update(Text(words, no_wrap=True, overflow="ellipsis"))
        elif time.monotonic() - self._last >= self._every:
            self._last = time.monotonic()
            self.say(words)


@contextmanager
def progress_bar(
    total: int, title: str, unit: str = "", stream: TextIO | None = None
) -> Iterator[Advance]:
    """A bar while ``total`` units are worked off; yields the function that advances it.

    Writes to ``stream``, stderr by default, so that results on stdout stay clean. Without a
    terminal, a line at the start, every ten seconds and at the end. The bar goes when it is done.
    """
    console = Console(file=stream or sys.stderr, highlight=False)
    if not console.is_terminal or console.is_dumb_terminal:
        yield from _lines(total, title, unit, console.file)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=None, complete_style=BLUE, finished_style=GREEN),
        TaskProgressColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.fields[note]}", style="dim"),
    )
    with Progress(*columns, console=console, transient=True, expand=True) as progress:
        task = progress.add_task(title, total=total, note="")

        def advance(count: int = 1, note: str = "") -> None:
            progress.advance(task, count)
            if note:
                progress.update(task, note=printable(note))

        yield advance


def _lines(total: int, title: str, unit: str, file: Any) -> Iterator[Advance]:
    start = time.monotonic()
    last = start
    done = 0

    def say(words: str) -> None:
        file.write(f"{title}: {words}\n")
        file.flush()

    def advance(count: int = 1, note: str = "") -> None:
        nonlocal done, last
        done += count
        now = time.monotonic()
        if now - last < LINE_EVERY or done >= total:
            return
        last = now
        left = (now - start) / max(done, 1) * (total - done)
        tail = f", {printable(note)}" if note else ""
        say(f"{done} of {total} {unit}".rstrip() + f", {duration(left)} left{tail}")

    say(f"{total} {unit}".rstrip())
    yield advance
    say(f"{done} of {total} {unit}".rstrip() + f" in {duration(time.monotonic() - start)}")


def summary_table(
    rows: Sequence[Mapping[str, Any]], title: str = "", columns: Sequence[str] | None = None
) -> Table:
    """A table of ``rows``; ``columns`` (all keys, in order of appearance) may choose.

    Numbers stand right with about three significant digits, None as a dash. Strings are taken
    as they are, so that a cell may say ``0.52 ± 0.03``.
    """
    names = (
        list(columns) if columns is not None else list(dict.fromkeys(k for r in rows for k in r))
    )
    table = Table(
        title=title or None,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        header_style="dim",
        pad_edge=False,
        show_edge=False,
    )
    for i, name in enumerate(names):
        values = [row.get(name) for row in rows]
        words = i == 0 or any(isinstance(v, str) and not v[:1].isdigit() for v in values)
        table.add_column(
            Text(name.replace("_", " ")),
            justify="left" if words else "right",
            style="bold" if i == 0 else "",
            no_wrap=i > 0,
        )
    for row in rows:
        table.add_row(*(Text(_cell(row.get(name))) for name in names))
    return table


def _cell(value: Any) -> str:
    if value is None:
        return MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return number(value)
    return printable(str(value))


def print_table(
    rows: Sequence[Mapping[str, Any]],
    title: str = "",
    columns: Sequence[str] | None = None,
    file: TextIO | None = None,
) -> None:
    """Print ``summary_table`` to ``file`` (stdout); a pipe gets full width and no colours."""
    console = Console(file=file or sys.stdout, highlight=False)
    table = summary_table(rows, title, columns)
    if not console.is_terminal:
        # Rich would squeeze the table into 80 columns that a pipe does not have.
        needed = console.measure(table, options=console.options.update(width=500)).maximum
        console = Console(file=console.file, highlight=False, width=max(needed, 40))
    console.print(table)
