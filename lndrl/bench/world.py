"""``lndrl bench world``: control steps of the hybrid scenario on one core, without a policy."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from functools import wraps
from time import perf_counter
from typing import Any

from lndrl.bench.report import REPETITIONS
from lndrl.bench.scene import WORLDS, RandomActions, hybrid_config
from lndrl.navigation import VectorNavigation

PARTS = (
    ("people", "crowd", "advance"),
    ("robot_and_contacts", "world", "tick"),
    ("laser", "world", "scan"),
    ("laser", "world", "scan_sparse"),
    ("localization", "localization", "update"),
    ("episode_starts", "navigation", "reset"),
)
"""Parts of a step, and the objects and methods that do them."""


def measure(seconds: float) -> dict[str, Any]:
    """``steps_per_second`` with random actions, localization, observation and reward included.

    ``microseconds_by_part`` splits one control step, measured in a second pass so that taking
    the time does not slow the first; ``rest`` is observation, reward and records.
    """
    environment = VectorNavigation(hybrid_config(), 0, WORLDS)
    actions = RandomActions(environment.config, WORLDS)
    _drive(environment, actions, 0.2)  # compiles
    rates = [_drive(environment, actions, seconds / REPETITIONS) for _ in range(REPETITIONS)]
    return {
        "steps_per_second": statistics.median(rates),
        "microseconds_by_part": _split(environment, actions, seconds / 2),
    }


def _drive(environment: VectorNavigation, actions: RandomActions, seconds: float) -> float:
    """Control steps per second over about ``seconds``."""
    started = perf_counter()
    steps = 0
    while (elapsed := perf_counter() - started) < seconds or steps == 0:
        environment.step(actions())
        steps += len(environment)
    return steps / elapsed


def _split(
    environment: VectorNavigation, actions: RandomActions, seconds: float
) -> dict[str, float]:
    spent = {part: 0.0 for part, _, _ in PARTS}
    for navigation in environment.worlds:
        owners = {
            "navigation": navigation,
            "world": navigation.world,
            "crowd": navigation.world.crowd,
            "localization": navigation.localization,
        }
        for part, owner, method in PARTS:
            setattr(owners[owner], method, _timed(getattr(owners[owner], method), spent, part))
    started = perf_counter()
    steps = 0
    while (elapsed := perf_counter() - started) < seconds or steps == 0:
        environment.step(actions())
        steps += len(environment)
    # The first scan and update of an episode belong to its start, but are counted by their part.
    micros = {part: 1e6 * total / steps for part, total in spent.items()}
    micros["rest"] = 1e6 * elapsed / steps - sum(micros.values())
    return micros


def _timed(method: Callable[..., Any], spent: dict[str, float], part: str) -> Callable[..., Any]:
    """``method`` that adds its seconds to ``spent[part]``, without those of parts within it."""

    @wraps(method)
    def call(*arguments: Any) -> Any:
        inner = sum(spent.values())
        started = perf_counter()
        result = method(*arguments)
        elapsed = perf_counter() - started
        spent[part] += elapsed - (sum(spent.values()) - inner)
        return result

    return call
