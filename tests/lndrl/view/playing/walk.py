"""A short made-up walk with everything that is known of one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lndrl.navigation import WorldSnapshot
from lndrl.navigation.reward import REWARD_PARTS


def walk(world: Callable[..., WorldSnapshot], outcome: str) -> list[WorldSnapshot]:
    """Start and three steps of 0.4 s, the last of which ends as ``outcome``."""
    moments = []
    for k in range(4):
        end = outcome if k == 3 else ""
        ends = {"arrived": (2, 500.0), "lost": (4, -500.0)}.get(end)
        parts = np.array([2.0, -1.0, 0.0, 0.0, 0.0, -5.0]) * (k > 0)
        if ends is not None:
            parts[ends[0]] = ends[1]
        snapshot = world(steps=k, outcome=end)
        x, y = snapshot.pose_estimated[:2]
        moments.append(
            replace(
                snapshot,
                covariance=np.diag([0.04, 0.01, 0.02]),
                weights=np.full(len(snapshot.particles), 1.0 / len(snapshot.particles)),
                clusters=np.array([[0.75, x, y], [0.25, x + 1.0, y]]),
                position_error=2.5 if end == "lost" else 0.1 * k,
                angle_error=0.05 * k,
                lost_distance=2.0,
                lost_angle=np.pi / 4,
                part_names=REWARD_PARTS,
                parts=parts,
                actions=np.array([(v, w) for v in (0.0, 0.6) for w in (-0.9, 0.0, 0.9)]),
                probabilities=np.array([0.0, 0.1, 0.0, 0.1, 0.6, 0.2]) if k else np.zeros(0),
                action=4 if k else -1,
                pose_odometry=np.array([0.3 * k, 0.01 * k, 0.02 * k]),
            )
        )
    return moments
