"""``lndrl bench reward``: what a reward term in Python costs beside the compiled reward."""

from __future__ import annotations

import statistics
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.bench.scene import WORLDS, RandomActions, hybrid_config
from lndrl.config import RunConfig
from lndrl.extensions import trust_modules
from lndrl.navigation import VectorNavigation
from lndrl.navigation.terms import Steps

_TURNS = 15


class PersonalSpace:
    """Pays -1 per person within ``distance`` m of the robot; about what users would write."""

    def __init__(self, config: RunConfig, distance: float = 1.0) -> None:
        self.distance = distance

    def __call__(self, steps: Steps) -> NDArray[np.float64]:
        to_robot = steps.pedestrian_position - steps.pose_true[:, None, :2]
        there = np.arange(to_robot.shape[1]) < steps.pedestrian_count[:, None]
        near = np.hypot(to_robot[..., 0], to_robot[..., 1]) < self.distance
        return -(near & there).sum(axis=1).astype(np.float64)


def measure(seconds: float) -> dict[str, Any]:
    """``steps_per_second`` of worlds without a policy: ``compiled`` alone, and with ``one_term``.

    Both on hybrid, where 8 worlds share a place and one call pays for all of them, and on random
    layouts, where each world has a place and a call of its own. Medians over short turns that all
    take one after the other, so that what else the machine does meets all alike.
    ``microseconds_per_step`` is what a term adds to a step of a world, by the fastest turns.
    """
    trust_modules(__name__)
    term = [f"task.reward.terms.space.use={__name__}:PersonalSpace"]
    places = {"hybrid": ["scenario=hybrid"], "random": ["scenario=random"]}
    environments = {
        (place, name): VectorNavigation(hybrid_config([*where, *more]), 0, WORLDS)
        for place, where in places.items()
        for name, more in (("compiled", []), ("one_term", term))
    }
    rates: dict[tuple[str, str], list[float]] = {key: [] for key in environments}
    share = seconds / (_TURNS * len(environments))
    for turn in range(_TURNS + 1):
        for key, environment in environments.items():
            rate = _drive(environment, share)
            if turn > 0:  # the first warms up
                rates[key].append(rate)
    best = {key: max(found) for key, found in rates.items()}
    return {
        "steps_per_second": {
            f"{place}_{name}": statistics.median(found) for (place, name), found in rates.items()
        },
        "microseconds_per_step": {
            place: 1e6 / best[place, "one_term"] - 1e6 / best[place, "compiled"] for place in places
        },
    }


def _drive(environment: VectorNavigation, seconds: float) -> float:
    """Control steps of a world per second, over about ``seconds``."""
    actions = RandomActions(environment.config, len(environment))
    started = perf_counter()
    steps = 0
    while (elapsed := perf_counter() - started) < seconds or steps == 0:
        environment.step(actions())
        steps += len(environment)
    return steps / elapsed
