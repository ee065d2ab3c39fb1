"""The rows of a ``metrics.jsonl`` that grows, and is cut where a run is resumed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

Row = Mapping[str, Any]


def made_at(row: Row) -> float:
    """When a row was made (unix s); rows of a file come in this order."""
    place = row["validation"] if "validation" in row else row["time"]
    return float(place["unix"])


class Feed:
    """Hands out each row once.

    ``after``: rows that were made up to then (unix s) are known already. A resumed learner cuts
    what came after its checkpoint and makes those updates anew; so the time says what is new.
    """

    def __init__(self, path: Path, after: float = 0.0) -> None:
        self._path, self._after = path, after
        self._offset = 0
        self._last = b""  # the line before the offset

    def read(self) -> list[Row]:
        """Rows that are new; none where there is no file. Raises OSError."""
        try:
            with self._path.open("rb") as file:
                file.seek(max(0, self._offset - len(self._last)))
                if file.read(len(self._last)) != self._last:
                    file.seek(0)  # it was cut, and has grown again
                    self._offset = 0
                data = file.read()
        except FileNotFoundError:
            return []
        whole = data[: data.rfind(b"\n") + 1]  # a learner may be at the rest
        if whole:
            self._offset += len(whole)
            self._last = whole[whole.rstrip(b"\n").rfind(b"\n") + 1 :]
        rows = [row for line in whole.splitlines() if (row := _row(line)) is not None]
        new = [row for row in rows if made_at(row) > self._after]
        self._after = max(map(made_at, new), default=self._after)
        return new


def _row(line: bytes) -> Row | None:
    """The row in a line; None for one that a killed learner has left half written."""
    try:
        row = json.loads(line)
        made_at(row)
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    return row if isinstance(row, dict) else None
