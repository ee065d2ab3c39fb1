"""The configuration of a run that trains for a moment."""

from __future__ import annotations

from typing import Any


def small_run(steps: int, time_limit: float, validation_episodes: int = 0) -> dict[str, Any]:
    """A run of ``steps`` in hybrid: one actor, tiny networks, episodes of ``time_limit`` s."""
    return {
        "scenario": "hybrid",
        "network": {"map_channels": [4, 4, 8], "features": 16, "goal_features": 8},
        "ppo": {"batch_size": 64, "minibatch_size": 32, "epochs": 1, "teacher": None},
        "learner": {
            "total_steps": steps,
            "threads": 1,
            "validation_episodes": validation_episodes,
        },
        "actor": {"count": 1, "worlds": 2, "horizon": 16},
        "localization": {"min_particles": 60, "max_particles": 120},
        "task": {"time_limit": time_limit},
    }
