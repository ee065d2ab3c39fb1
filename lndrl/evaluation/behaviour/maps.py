"""Sums over the cells of a map, and how far two methods differ in each."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.evaluation.behaviour.course import Course

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

CELL = 1.0
"""m, side of a cell."""
FEW_STEPS = 10
"""Cells in which either method has taken fewer steps say nothing of turning and waiting."""
FEW_EPISODES = 5
"""Cells through which both together have come in fewer episodes say nothing of ways."""
MAPS = ("turning", "waiting", "ways")


@dataclass(frozen=True, eq=False)
class Cells:
    """Sums over courses, each (rows, columns), row 0 at y = 0.

    ``steps`` that began in a cell, rad ``turned`` in them, how many of them were ``waited``, and
    the ``episodes`` that came through, each counted once: who waits somewhere goes no other way.
    ``courses`` and ``seconds`` are how many there were and how long a step is.
    """

    steps: Counts
    turned: Floats
    waited: Counts
    episodes: Counts
    courses: int
    seconds: float

    def turning(self) -> Floats:
        """Mean absolute turn rate (rad/s), NaN below ``FEW_STEPS``."""
        return self._per_step(self.turned / self.seconds)

    def waiting(self) -> Floats:
        """Share of the steps that were waited, NaN below ``FEW_STEPS``."""
        return self._per_step(self.waited.astype(np.float64))

    def ways(self) -> Floats:
        """Share of all episodes that came through."""
        return self.episodes / max(self.courses, 1)

    def _per_step(self, sums: Floats) -> Floats:
        known = self.steps >= FEW_STEPS
        return np.where(known, sums / np.maximum(self.steps, 1), np.nan)


def cells_of(courses: Iterable[Course], size: tuple[float, float], cell: float = CELL) -> Cells:
    """Sums over ``courses`` in a place of ``size`` (m) in cells of ``cell`` metres.

    What lies outside counts in the cell at the edge. Raises ValueError for a cell of no size.
    """
    if not cell > 0.0:
        raise ValueError(f"cells of {cell} m cannot be counted in")
    shape = math.ceil(size[1] / cell - 1e-9), math.ceil(size[0] / cell - 1e-9)
    steps, waited = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    turned, episodes = np.zeros(shape), np.zeros(shape, np.int64)
    count, seconds = 0, 1.0
    for course in courses:
        count, seconds = count + 1, course.seconds
        column, row = np.floor(course.places / cell).astype(np.int64).T
        at = np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)
        np.add.at(steps, at, 1)
        np.add.at(turned, at, course.turned)
        np.add.at(waited, at, course.waited)
        episodes[at] += 1  # once, however often it is named
    return Cells(steps, turned, waited, episodes, count, seconds)


def differences(first: Cells, second: Cells) -> dict[str, Floats]:
    """``first`` less ``second`` (rows, columns) under the names of ``MAPS``; NaN: says nothing.

    Turning in rad/s, waiting and ways in points.
    """
    ways = 100 * (first.ways() - second.ways())
    ways[first.episodes + second.episodes < FEW_EPISODES] = np.nan
    return {
        "turning": first.turning() - second.turning(),
        "waiting": 100 * (first.waiting() - second.waiting()),
        "ways": ways,
    }
