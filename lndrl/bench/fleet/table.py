"""The rows of a fleet bench as people read them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.table import Table

from lndrl.bench.report import value_text

_COLUMNS = {
    "actors": "actors",
    "worlds": "worlds",
    "offered_steps_per_second": "offered/s",
    "steps_per_second": "steps/s",
    "predicted_steps_per_second": "by the model",
    "efficiency": "of linear",
    "ack_p50_ms": "ack p50 ms",
    "ack_p99_ms": "p99 ms",
    "status_p99_ms": "status p99 ms",
    "weights_seconds": "weights s",
    "lag_mean": "lag",
    "lost": "lost",
    "learner_cores": "cores",
    "learner_rss_mb": "MB",
}
_UPDATES = {
    "drain": "the update is replaced by a drain that only books what came",
    "real": "with real training",
}


def with_efficiency(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """``rows`` with ``efficiency``: steps/s per actor over that of the row with fewest actors."""
    if not rows:
        return []
    least = min(rows, key=lambda row: row["actors"])
    each = least["steps_per_second"] / least["actors"]
    return [
        row | {"efficiency": row["steps_per_second"] / row["actors"] / each if each else None}
        for row in rows
    ]


def table(rows: Sequence[dict[str, Any]], update: str) -> Table:
    """The rows; ``update`` as in Plan."""
    found = Table(title=f"fleet: one learner, {_UPDATES[update]}", title_justify="left")
    for title in _COLUMNS.values():
        found.add_column(title, justify="right")
    for row in with_efficiency(rows):
        values = [row[key] for key in _COLUMNS]
        found.add_row(*("–" if value is None else value_text(value) for value in values))
    return found
