"""What one update leaves in ``metrics.jsonl`` and in the history that dashboards show."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from lndrl.transport.status import overhead

if TYPE_CHECKING:
    from learner.learner import Learner


def metrics_row(learner: Learner, phase: str, samples: int, seconds: float) -> dict[str, Any]:
    """The row of the newest update, in ``phase``, on so many samples, which took so long."""
    counters, whole, split = learner.counters, learner.whole, learner.split
    shares, spent, actors = split.shares(), split.totals(), whole.actor_shares()
    return {
        "update": counters.updates,
        "steps": counters.steps,
        "version": counters.version,
        "samples": samples,
        "episodes": learner.episodes.figures(),
        "reward_parts": learner.episodes.reward_parts(),
        "phase": phase,
        "ppo": learner.figures,
        "lag": learner.lag,
        "time": {
            "unix": time.time(),
            "elapsed": learner.elapsed,
            "update": seconds,
            "steps_per_second": whole.rates()["60s"],
            "actors": learner.roster.counts()[0],
            **{f"share_{name}": share for name, share in shares.items()},
            **{f"actor_share_{name}": share for name, share in actors.items()},
            "overhead_learner": overhead(shares),
            "overhead_actor": overhead(actors),
            # Sums since this learner started: what lies between two rows is exact.
            "spent": {
                "learner": spent,
                "actors": whole.actor_totals(),
                "actor_steps": whole.actor_steps(),
            },
        },
    }


def history_row(row: dict[str, Any]) -> dict[str, Any]:
    """What dashboards draw of a row of ``metrics.jsonl``."""
    episodes = row["episodes"]
    names = ("arrived", "collided", "lost", "timeout", "mean_return")
    return {
        "time": row["time"]["unix"],
        "steps": row["steps"],
        "rate": row["time"]["steps_per_second"],
        **{name: episodes[name] for name in names},
        "kl": row["ppo"].get("kl"),
        "entropy": row["ppo"].get("entropy"),
        "lag": row["lag"]["mean"],
    }
