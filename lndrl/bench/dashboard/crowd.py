"""The status of a learner with hundreds of actors, made up, another one at each call."""

from __future__ import annotations

import math
import time
from typing import Any

from lndrl.transport.status import ACTOR_ACTIVITIES, LEARNER_ACTIVITIES


def snapshot(actors: int, turn: int) -> dict[str, Any]:
    """What ``lndrl.transport.status.Status`` describes, in the ``turn``-th second of a run."""
    wave = 0.5 + 0.4 * math.sin(turn / 20.0)
    return {
        "run_id": "bench",
        "run_name": "bench",
        "verdict": "learning",
        "time": time.time(),
        "uptime": float(turn),
        "steps": 1000 * turn,
        "total_steps": 10_000_000,
        "updates": turn,
        "weights_version": turn,
        "rate": {"10s": 3000.0 + turn, "60s": 2990.0, "300s": 2950.0},
        "eta": 3600.0,
        "time_split": dict.fromkeys(LEARNER_ACTIVITIES, 1.0 / len(LEARNER_ACTIVITIES)),
        "actor_split": dict.fromkeys(ACTOR_ACTIVITIES, 1.0 / len(ACTOR_ACTIVITIES)),
        "actors": [_actor(i, turn) for i in range(actors)],
        "episodes": {"count": 10 * turn, "window": 500, **_outcomes(wave), "mean_return": wave},
        "ppo": {"kl": 0.01 * wave, "entropy": 2.0 + wave, "value_loss": 0.5, "policy_loss": 0.1},
        "lag": {"mean": wave, "max": 3, "shares": [0.5, 0.25, 0.15, 0.1]},
        "events": [
            {"time": float(turn + i), "kind": "join", "text": f"actor-{i} from host-{i % 40}"}
            for i in range(50)
        ],
    }


def history(rows: int) -> list[dict[str, Any]]:
    """As many rows as a learner keeps of a long run."""
    return [
        {
            "time": float(i),
            "steps": 1000 * i,
            "rate": 3000.0,
            **_outcomes(0.2 + 0.6 * i / rows),
            "mean_return": float(i),
            "kl": 0.01,
            "entropy": 2.0,
            "lag": 0.5,
        }
        for i in range(rows)
    ]


def _outcomes(arrived: float) -> dict[str, float]:
    rest = (1.0 - arrived) / 3.0
    return {"arrived": arrived, "collided": rest, "lost": rest, "timeout": rest}


def _actor(i: int, turn: int) -> dict[str, Any]:
    state = "gone" if i % 97 == 3 else "slow" if i % 31 == 5 else "active"
    return {
        "id": f"actor-{i}",
        "host": f"host-{i % 40}",
        "pid": 1000 + i,
        "worlds": 8,
        "state": state,
        "last_ack_age": 20.0 + turn if state != "active" else 0.1 * (i % 9),
        "lag": (i + turn) % 3,
        "steps": 1000 * turn + i,
        "rate": 10.0 + 0.01 * ((i * turn) % 100),
        "time_split": dict.fromkeys(ACTOR_ACTIVITIES, 1.0 / len(ACTOR_ACTIVITIES)),
        "machine": {"cpu": 0.5, "memory": 0.25, "cores": 16.0, "gigabytes": 64.0},
    }
