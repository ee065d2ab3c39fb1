"""``lndrl bench gym``: control steps of many worlds as Gymnasium's users take them."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from time import perf_counter
from typing import Any

import gymnasium

from lndrl.bench.scene import RandomActions, hybrid_config
from lndrl.navigation import VectorNavigation
from lndrl.registration import ENVIRONMENT

ENVIRONMENTS = 32
_TURNS = 15


def measure(seconds: float) -> dict[str, Any]:
    """Control steps per second of 32 worlds of hybrid with random actions, no policy.

    ``steps_per_second_raw``: ``VectorNavigation``, what actors use; ``_vector``: the vector
    environment around it, ``vectorization_mode="vector_entry_point"``; ``_sync``: Gymnasium's
    own loop over single environments. All three run in one thread of one process
    (``cores_used``). Medians over short turns that they take one after the other, so that what
    else the machine does meets all alike; ``vector_of_raw`` and ``sync_of_raw`` are medians of the
    turns' own ratios.
    """
    config = hybrid_config()
    raw = VectorNavigation(config, worlds=ENVIRONMENTS)
    made = {
        mode: gymnasium.make_vec(ENVIRONMENT, ENVIRONMENTS, vectorization_mode=mode, config=config)
        for mode in ("vector_entry_point", "sync")
    }
    for environment in made.values():
        environment.reset(seed=config.seed)
    actions = RandomActions(config, ENVIRONMENTS)
    steps: dict[str, Callable[[], Any]] = {
        "raw": lambda: raw.step(actions()),
        "vector": lambda: made["vector_entry_point"].step(actions()),
        "sync": lambda: made["sync"].step(actions()),
    }
    rates: dict[str, list[float]] = {name: [] for name in steps}
    for turn in range(_TURNS + 1):
        for name, step in steps.items():
            rate = _rate(step, seconds / (_TURNS * len(steps)))
            if turn > 0:  # the first warms up
                rates[name].append(rate)
    for environment in made.values():
        environment.close()
    figures: dict[str, Any] = {
        f"steps_per_second_{name}": statistics.median(rates[name])
        for name in ("sync", "vector", "raw")
    }
    for name in ("sync", "vector"):
        ratios = [mine / own for mine, own in zip(rates[name], rates["raw"], strict=True)]
        figures[f"{name}_of_raw"] = statistics.median(ratios)
    return {**figures, "environments": ENVIRONMENTS, "cores_used": 1}


def _rate(step: Callable[[], Any], seconds: float) -> float:
    started = perf_counter()
    taken = 0
    while (elapsed := perf_counter() - started) < seconds or taken == 0:
        step()
        taken += ENVIRONMENTS
    return taken / elapsed
