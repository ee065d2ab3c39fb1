"""The course of a whole run in a bounded number of rows, from before a resume as well."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

Row = dict[str, Any]
MOST_ROWS = 600


class History:
    """Every k-th row since the run began, and always the newest.

    When there are too many, every second one goes and k doubles, so that what is drawn of it has
    one scale of time from the beginning to now. For one thread; others may iterate.
    """

    def __init__(self, most: int = MOST_ROWS) -> None:
        self._most = most
        self._stride = 1
        self._count = 0
        self._kept: list[Row] = []
        self._newest: Row | None = None

    def __iter__(self) -> Iterator[Row]:
        kept, newest = self._kept, self._newest
        return iter(kept if newest is None or kept[-1:] == [newest] else [*kept, newest])

    def add(self, row: Row) -> None:
        """The row of one more update."""
        kept = self._kept
        if self._count % self._stride == 0:
            kept = [*kept, row]
        self._count += 1
        while len(kept) > self._most:
            kept, self._stride = kept[::2], 2 * self._stride
        # Replaced, never changed: whoever iterates goes on with what there was.
        self._kept, self._newest = kept, row

    def take_up(self, path: Path, drawn: Callable[[Row], Row]) -> None:
        """Begin with the updates of a ``metrics.jsonl``; ``drawn`` makes a row here of one there.

        Only as many lines are read as are kept. Damaged ones are left out, and where there is no
        file there is no history.
        """
        try:
            count = sum(1 for _ in _updates(path))
            while count > self._most * self._stride:
                self._stride *= 2
            for i, line in enumerate(_updates(path)):
                if i % self._stride == 0:
                    with suppress(ValueError, KeyError, TypeError, AttributeError, RecursionError):
                        self._kept.append(drawn(json.loads(line)))
        except OSError:
            return
        self._count = count
        self._newest = self._kept[-1] if self._kept else None


def _updates(path: Path) -> Iterator[bytes]:
    """The lines of updates; those of validated versions stand between them."""
    with path.open("rb") as file:
        yield from (line for line in file if b'"validation"' not in line[:200] and b'"ppo"' in line)
