"""Ways through a known place on which scans keep the pose pinned down.

On the places of a localizability field, joined to their neighbours and by knight's moves, every
move costs its length, and more where a scan along that heading tells little.
What is left of the way from a place is what a planner that looks ahead cannot see.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from lndrl.maps.localizability import LocalizabilityField
from lndrl.world import Place

Floats = NDArray[np.float64]

_MOVES = (
    (0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1),
    (1, 2), (2, 1), (-1, 2), (2, -1), (1, -2), (-2, 1), (-1, -2), (-2, -1),
)  # fmt: skip
"""Rows up and columns right of a move."""


class WayPrices(NamedTuple):
    """What moves cost beyond their length, in m per m driven.

    ``doubt`` per m of deviation above ``sure`` (m), up to ``unsure`` (m). No way leads where there
    is less than ``room`` m to a wall.
    """

    doubt: float
    sure: float
    unsure: float
    room: float


@dataclass(frozen=True, eq=False)
class Ways:
    """Moves through a place; ``number`` (rows, columns) is that of the node at a place of the
    field, -1 where the robot does not fit. ``spacing`` m.
    """

    number: NDArray[np.int64]
    spacing: float
    _back: Any

    @classmethod
    def build(cls, place: Place, field: LocalizabilityField, prices: WayPrices) -> Ways:
        """All moves of ``place``, whose field is ``field``."""
        fits = _room(place, field) >= prices.room
        number = np.full(fits.shape, -1, np.int64)
        number[fits] = np.arange(np.count_nonzero(fits))
        starts, ends, costs = [], [], []
        for up, right in _MOVES:
            heading = np.arctan2(up, right)
            doubt = np.clip(field.towards(heading), prices.sure, prices.unsure) - prices.sure
            price = (1.0 + prices.doubt * doubt)[fits]
            here, there = _shifted(number, up, right)
            both = (here >= 0) & (there >= 0)
            a, b = here[both], there[both]
            length = field.spacing * np.hypot(up, right)
            starts.append(a)
            ends.append(b)
            costs.append(0.5 * length * (price[a] + price[b]))
        pairs = (np.concatenate(ends), np.concatenate(starts))
        size = np.count_nonzero(fits)
        back = csr_matrix((np.concatenate(costs), pairs), shape=(size, size))
        return cls(number, field.spacing, back)

    def left(self, goal: Floats) -> Floats:
        """What the cheapest way to ``goal`` (2,) m costs from every place (rows, columns), in m.

        Where none leads, what it costs from the nearest place with one.
        """
        rows, columns = np.nonzero(self.number >= 0)
        out = np.zeros(self.number.shape)
        if not len(rows):
            return out
        at = np.asarray(goal) / self.spacing - 0.5
        first = int(np.argmin((rows - at[1]) ** 2 + (columns - at[0]) ** 2))
        cost = dijkstra(self._back, indices=first)
        reached = np.isfinite(cost)
        known = np.zeros(self.number.shape, bool)
        known[rows[reached], columns[reached]] = True
        out[known] = cost[reached]
        nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
        filled: Floats = out[nearest[0], nearest[1]]
        return filled


def _room(place: Place, field: LocalizabilityField) -> Floats:
    """Metres to the nearest wall from the middle of every place of the field."""
    rows, columns = field.free.shape
    resolution, (height, width) = place.grid.resolution, place.distance.shape
    row = ((np.arange(rows) + 0.5) * field.spacing / resolution).astype(int)
    column = ((np.arange(columns) + 0.5) * field.spacing / resolution).astype(int)
    distance = place.distance[np.ix_(np.minimum(row, height - 1), np.minimum(column, width - 1))]
    inside = (row < height)[:, None] & (column < width)[None]
    return np.where(inside, distance - 0.5 * resolution, 0.0).astype(np.float64)


def _shifted(number: NDArray[np.int64], up: int, right: int) -> tuple[NDArray[np.int64], ...]:
    """Views of all places from which a move stays on the map, and of where it leads."""
    rows, columns = number.shape
    here = number[max(0, -up) : rows - max(0, up), max(0, -right) : columns - max(0, right)]
    there = number[max(0, up) : rows + min(0, up), max(0, right) : columns + min(0, right)]
    return here, there
