"""``lndrl bench gym``: control steps of many worlds as Gymnasium's users take them."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from time import perf_counter, process_time, thread_time
from typing import Any, NamedTuple

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
    own loop over single environments. Medians over short turns that they take one after the other,
    so that what else the machine does meets all alike. ``vector_of_raw`` and ``sync_of_raw``
    compare the calling thread's own time in those turns, and ``cores_used`` is how many times as
    much the vector environment's whole process took: 1, there is no other thread.
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
    turns: dict[str, list[_Turn]] = {name: [] for name in steps}
    for turn in range(_TURNS + 1):
        for name, step in steps.items():
            taken = _take(step, seconds / (_TURNS * len(steps)))
            if turn > 0:  # the first warms up
                turns[name].append(taken)
    for environment in made.values():
        environment.close()
    figures: dict[str, Any] = {
        f"steps_per_second_{name}": statistics.median(t.steps / t.seconds for t in turns[name])
        for name in ("sync", "vector", "raw")
    }
    for name in ("sync", "vector"):
        pairs = zip(turns[name], turns["raw"], strict=True)
        ratios = [(raw.own / raw.steps) / (mine.own / mine.steps) for mine, raw in pairs]
        figures[f"{name}_of_raw"] = statistics.median(ratios)
    cores = statistics.median(turn.whole / turn.own for turn in turns["vector"])
    return {**figures, "environments": ENVIRONMENTS, "cores_used": round(cores, 2)}


class _Turn(NamedTuple):
    steps: int
    seconds: float
    own: float  # s of the calling thread
    whole: float  # s of all threads of the process


def _take(step: Callable[[], Any], seconds: float) -> _Turn:
    started, own, whole = perf_counter(), thread_time(), process_time()
    taken = 0
    while (elapsed := perf_counter() - started) < seconds or taken == 0:
        step()
        taken += ENVIRONMENTS
    return _Turn(taken, elapsed, thread_time() - own, process_time() - whole)
