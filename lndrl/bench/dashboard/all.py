"""All that a dashboard costs: who looks, and who is looked at."""

from __future__ import annotations

from typing import Any

from lndrl.bench.dashboard import live, viewer


def measure(seconds: float) -> dict[str, Any]:
    """The viewer's CPU by size of its terminal, and ``live_world``: the watched actor's."""
    return {**viewer.measure(seconds), "live_world": live.measure(seconds)}
