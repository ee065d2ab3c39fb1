"""Episodes made by hand: every figure of every moment is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from lndrl.evaluation.lost import COLUMNS, Trace


def trace_of(
    outcome: str,
    off: Sequence[float],
    turn: float = 0.0,
    scenario: str = "room",
    episode: int = 0,
    **columns: ArrayLike,
) -> Trace:
    """A robot that drives along x, half a metre a step, and believes to be ``off`` m beside it.

    ``turn`` rad in every step, which it knows of; ``columns`` replace those of their name.
    """
    moments = np.zeros((len(off), len(COLUMNS)))
    at = {name: i for i, name in enumerate(COLUMNS)}
    moments[:, at["x"]] = moments[:, at["x_estimated"]] = 0.5 * np.arange(len(off))
    moments[:, at["y_estimated"]] = off
    yaw = turn * np.arange(len(off))
    moments[:, at["yaw"]] = moments[:, at["yaw_estimated"]] = (yaw + np.pi) % (2 * np.pi) - np.pi
    moments[:, at["particles"]] = 501
    moments[:, at["slow_average"]], moments[:, at["fast_average"]] = 0.02, 0.05
    moments[:, at["first_cluster"]] = 1.0
    for name, values in columns.items():
        moments[:, at[name]] = values
    return Trace(scenario, episode, outcome, moments)
