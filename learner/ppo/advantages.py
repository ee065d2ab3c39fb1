"""Generalized advantage estimation with ends told apart (Schulman et al. 2016; PAPER via GROUP).

An episode that *terminates* has no value afterwards. One that is *truncated*, or cut by the end
of a chunk, goes on: its last step bootstraps from the value of the observation that followed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]


def generalized_advantages(
    reward: FloatArray,
    value: FloatArray,
    terminated: NDArray[np.bool_],
    truncated: NDArray[np.bool_],
    next_value_at_cuts: FloatArray,
    gamma: float,
    gae_lambda: float,
) -> tuple[FloatArray, FloatArray]:
    """Advantages and value targets of a chunk.

    All arrays are (T, B). ``next_value_at_cuts`` holds V(observation after step t) wherever the
    chunk itself does not hold that observation: at truncated steps and at T - 1; it is ignored
    elsewhere. Returns ``(advantage, advantage + value)``, float32 (T, B).
    """
    steps, worlds = reward.shape
    advantage = np.zeros((steps, worlds), np.float32)
    running = np.zeros(worlds, np.float64)
    for t in range(steps - 1, -1, -1):
        last = t == steps - 1
        inside = np.zeros(worlds, np.float32) if last else value[t + 1]
        cut = truncated[t] | last
        next_value = np.where(cut, next_value_at_cuts[t], inside)
        next_value = np.where(terminated[t], 0.0, next_value)
        delta = reward[t] + gamma * next_value - value[t]
        ends = terminated[t] | truncated[t]
        running = delta + gamma * gae_lambda * np.where(ends, 0.0, running)
        advantage[t] = running
    return advantage, advantage + value
