"""What the guard lets through when bodies do their worst, and what a decision costs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from lndrl.planners.guard import GuardConfig
from lndrl.robot.adversaries import Adversity, Arena
from lndrl.view.progress import progress_bar

CASES: dict[str, Adversity] = {
    "at once": Adversity(),
    "turtlebot2": Adversity(limits=(1.0, 1.0, 2.0)),
    "late": Adversity(limits=(1.0, 1.0, 2.0), latency=2),
    "as driven": Adversity(limits=(1.0, 1.0, 2.0), latency=1, ticks_per_step=1, holds=5),
    "alone": Adversity(bodies=0),
}
"""Robots that stop at once, that brake, that also act on scans that are 0.2 s old; commands that
``lndrl drive`` revises with every scan; and nobody."""
STEPS = 1_000_000
"""Control steps that the guarantee is tested by, over all cases together."""
_CHUNK = 500


def measure(seconds: float) -> dict[str, Any]:
    """Tallies by case (``Tally``), ``steps`` in all and ``microseconds`` of a step's decision.

    Every case gets the same share of ``seconds``; ``run`` takes a number of steps instead.
    """
    return _figures(
        {name: _contest(made, seconds / len(CASES), None) for name, made in CASES.items()}
    )


def run(steps: int = STEPS) -> dict[str, Any]:
    """``measure`` with ``steps`` control steps in all, however long they take, told as they go."""
    share = -(-steps // len(CASES))
    with progress_bar(share * len(CASES), "guard", "steps") as advance:
        tallies = {
            name: _contest(made, None, share, partial(advance, note=name))
            for name, made in CASES.items()
        }
    return _figures(tallies)


def _figures(tallies: dict[str, dict[str, Any]]) -> dict[str, Any]:
    total = sum(tally["steps"] for tally in tallies.values())
    touched = sum(tally["seen"] + tally["walls"] for tally in tallies.values())
    return {"steps": total, "touched what was seen": touched, **tallies}


def _contest(
    made: Adversity,
    seconds: float | None,
    steps: int | None,
    told: Callable[[int], None] = lambda count: None,
) -> dict[str, Any]:
    """Arenas of ``_CHUNK`` steps, each from a seed of its own, until the time or steps are over.

    ``told`` hears of so many steps more.
    """
    parameters = GuardConfig(delay=made.latency * made.tick)
    sums: dict[str, Any] = {}
    started, seed = perf_counter(), 0
    while True:
        count = _CHUNK if steps is None else min(_CHUNK, steps - sums.get("steps", 0))
        arena = Arena(parameters, made, np.random.default_rng([seed, 2024]))
        for _ in range(count):
            arena.step()
        for name, value in arena.tally.to_dict().items():
            sums[name] = sums.get(name, 0) + value
        seed += 1
        told(count)
        elapsed = perf_counter() - started
        over = elapsed >= seconds if seconds is not None else sums["steps"] >= (steps or 0)
        if over:
            break
    sums["standing"] = (sums["stood"] - sums["would_stand"]) / sums["steps"]
    return {**sums, "microseconds": 1e6 * elapsed / sums["steps"]}
