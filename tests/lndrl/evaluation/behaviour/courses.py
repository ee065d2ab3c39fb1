"""Courses that are made by hand or drawn."""

from __future__ import annotations

import numpy as np

from lndrl.evaluation.behaviour import Course


def drawn(
    seed: int, count: int, size: tuple[float, float], outcomes: tuple[str, ...] = ("arrived",)
) -> list[Course]:
    """Courses that wander through a place, some of their steps too short to be a move."""
    random = np.random.default_rng(seed)
    found = []
    for k in range(count):
        steps = int(random.integers(5, 40))
        moves = random.normal(0.0, 0.25, (steps, 2)) * (random.random((steps, 1)) > 0.3)
        start = random.uniform(0.2, 0.8, 2) * size
        places = np.clip(np.vstack([start, start + np.cumsum(moves, axis=0)]), 0.01, size)
        yaw = np.cumsum(random.normal(0.0, 0.5, steps + 1))
        poses = np.column_stack([places, (yaw + np.pi) % (2 * np.pi) - np.pi])
        found.append(Course(k, outcomes[k % len(outcomes)], poses, 0.4))
    return found
