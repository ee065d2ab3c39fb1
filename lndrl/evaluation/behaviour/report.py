"""What two methods did in the same episodes of a place: a map of the differences, and numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lndrl.evaluation.behaviour.course import Course
from lndrl.evaluation.behaviour.maps import CELL, Cells, Floats, cells_of, differences
from lndrl.evaluation.hazard import Hazard
from lndrl.maps.grid import OccupancyGrid


@dataclass(frozen=True)
class Numbers:
    """Of one method over all its episodes.

    ``turn`` rad per control step, ``waiting`` the share of steps, ``path`` the mean length (m) of
    the episodes in which both methods arrived, None without any.
    """

    method: str
    episodes: int
    arrived: float
    turn: float
    waiting: float
    path: float | None
    hazard: Hazard

    @classmethod
    def of(cls, method: str, courses: Sequence[Course], shared: set[int]) -> Numbers:
        """Of ``courses``; ``shared`` are the episodes in which both arrived."""
        steps = sum(course.steps for course in courses)
        lengths = [float(c.moved.sum()) for c in courses if c.episode in shared]
        return cls(
            method,
            len(courses),
            sum(c.outcome == "arrived" for c in courses) / max(len(courses), 1),
            sum(float(c.turned.sum()) for c in courses) / max(steps, 1),
            sum(int(c.waited.sum()) for c in courses) / max(steps, 1),
            float(np.mean(lengths)) if lengths else None,
            Hazard(sum(c.outcome == "lost" for c in courses), steps),
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain types; ``hazard`` is lost per 1,000 control steps."""
        interval = list(self.hazard.interval)
        return {**asdict(self), "hazard": self.hazard.value, "hazard_interval": interval}


@dataclass(frozen=True, eq=False)
class BehaviourReport:
    """Two ``methods`` in the same episodes of ``scenario``, whose map is ``grid``."""

    methods: tuple[str, str]
    scenario: str
    grid: OccupancyGrid
    courses: tuple[Sequence[Course], Sequence[Course]]
    cell: float = CELL

    @cached_property
    def cells(self) -> tuple[Cells, Cells]:
        """Sums over the cells of the map, of each method."""
        first, second = (cells_of(each, self.grid.size, self.cell) for each in self.courses)
        return first, second

    @cached_property
    def maps(self) -> dict[str, Floats]:
        """The first method less the second, see ``differences``."""
        return differences(*self.cells)

    @cached_property
    def numbers(self) -> tuple[Numbers, Numbers]:
        """Of each method."""
        arrived = [{c.episode for c in each if c.outcome == "arrived"} for each in self.courses]
        first, second = (
            Numbers.of(name, each, arrived[0] & arrived[1])
            for name, each in zip(self.methods, self.courses, strict=True)
        )
        return first, second

    def to_dict(self) -> dict[str, Any]:
        """Plain types; cells that say nothing are None, rows from y = 0 on."""
        maps = {
            name: [[None if np.isnan(v) else float(v) for v in row] for row in found]
            for name, found in self.maps.items()
        }
        return {
            "scenario": self.scenario,
            "methods": [each.to_dict() for each in self.numbers],
            "cell": self.cell,
            "maps": maps,
        }
