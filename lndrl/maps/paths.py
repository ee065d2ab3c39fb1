"""Ways through a map: shortest paths that keep off the walls, and few waypoints along them.

The grid's origin is (0, 0); ``distance`` is its distance field (m, centre to centre).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from lndrl.kernels import kernel
from lndrl.maps.raycast import sample_field

Floats = NDArray[np.float64]

_SPACING = 0.15  # m between nodes
_MOST_NODES = 250_000  # beyond, nodes lie farther apart
_SHY = 3.0  # a metre right at a wall costs as much as this many more
_OFFSETS = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows up, columns right


@dataclass(frozen=True, eq=False)
class Roadmap:
    """Nodes on a lattice wherever there is ``room`` m to every wall, and edges between them.

    ``nodes`` (N, 2) are positions (m), ``part`` (N,) numbers the connected parts, the largest 0.
    """

    distance: NDArray[np.float32]
    resolution: float
    nodes: Floats
    clear: Floats  # (N,) m from node to wall
    part: NDArray[np.intp]
    _graph: Any

    @classmethod
    def build(
        cls, distance: NDArray[np.float32], resolution: float, room: float, comfort: float
    ) -> Roadmap:
        """``comfort``: metres to a wall that paths would rather keep, where there is the room."""
        stride = max(1, round(_SPACING / resolution))
        while distance.size / stride**2 > _MOST_NODES:
            stride += 1
        first = stride // 2
        clear = distance[first::stride, first::stride].astype(np.float64) - 0.5 * resolution
        passable = clear >= room
        number = np.full(clear.shape, -1, np.int64)
        number[passable] = np.arange(passable.sum())
        row, column = np.nonzero(passable)
        nodes = np.asarray(
            (np.stack([column, row], axis=1) * stride + first + 0.5) * resolution, np.float64
        )
        kept = clear[passable]
        graph = _connect(number, kept, stride * resolution, comfort)
        count, part = connected_components(graph, directed=False)
        order = np.argsort(-np.bincount(part, minlength=count), kind="stable")
        rank = np.empty(count, np.intp)
        rank[order] = np.arange(count)
        return cls(distance, resolution, nodes, kept, rank[part], graph)

    def nearest(self, points: Floats) -> NDArray[np.intp]:
        """Number of the node nearest to each of ``points`` (n, 2)."""
        out = np.empty(len(points), np.intp)
        for i, point in enumerate(points):
            out[i] = np.argmin(((self.nodes - point) ** 2).sum(axis=1))
        return out

    def search(
        self, sources: NDArray[np.intp], limit: float = np.inf
    ) -> tuple[Floats, NDArray[np.int32]]:
        """Cost (n, N) from each source node to all and the way back.

        inf where no path leads that costs at most ``limit``: metres, more of them near walls.
        """
        cost, before = dijkstra(
            self._graph, directed=False, indices=sources, return_predecessors=True, limit=limit
        )
        return cost, before

    def trace(self, before: NDArray[np.int32], goal: int) -> Floats:
        """Positions (k, 2) from a source to the node ``goal``; ``before`` is its row of search."""
        chain = [goal]
        while before[chain[-1]] >= 0:
            chain.append(int(before[chain[-1]]))
        return self.nodes[chain[::-1]]

    def simplify(self, path: Floats, comfort: float) -> Floats:
        """The fewest of the path's points (k, 2) whose straight legs keep ``comfort`` m to walls,
        or as much as the path itself keeps there.
        """
        room = np.array([self._room(a, a) for a in path])
        kept = simplify_path(path, room, self.distance, 1.0 / self.resolution, comfort)
        return path[kept]

    def _room(self, a: Floats, b: Floats) -> float:
        return float(leg_room(self.distance, 1.0 / self.resolution, a[0], a[1], b[0], b[1]))

    def sees(self, a: Floats, b: Floats, room: float) -> bool:
        """Whether the straight leg from ``a`` to ``b`` keeps ``room`` m to every wall."""
        scale = 1.0 / self.resolution
        return bool(leg_keeps(self.distance, scale, a[0], a[1], b[0], b[1], room))


def path_length(path: Floats) -> float:
    """Metres along a polyline (k, 2)."""
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def _connect(number: NDArray[np.int64], clear: Floats, step: float, comfort: float) -> Any:
    """Sparse costs between neighbouring nodes, diagonals included."""
    pairs, costs = [], []
    for up, right in _OFFSETS:
        rows, columns = number.shape
        here = number[: rows - up, max(0, -right) : columns - max(0, right)]
        there = number[up:, max(0, right) : columns - max(0, -right)]
        both = (here >= 0) & (there >= 0)
        a, b = here[both], there[both]
        tight = np.clip(1.0 - np.minimum(clear[a], clear[b]) / comfort, 0.0, 1.0)
        pairs.append(np.stack([a, b]))
        costs.append(step * np.hypot(up, right) * (1.0 + _SHY * tight))
    a, b = np.concatenate(pairs, axis=1)
    return csr_matrix((np.concatenate(costs), (a, b)), shape=(len(clear), len(clear)))


@kernel()
def leg_room(distance, inverse_resolution, ax, ay, bx, by):
    """Least metres to a wall along the straight leg from a to b, to within half a cell."""
    length = np.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
    steps = int(length * inverse_resolution) + 1
    least = 1e30
    for k in range(steps + 1):
        u = k / steps
        room = sample_field(distance, inverse_resolution, ax + u * (bx - ax), ay + u * (by - ay))
        least = min(least, room)
    return least - 0.5 / inverse_resolution


@kernel()
def leg_keeps(distance, inverse_resolution, ax, ay, bx, by, room):
    """Whether ``leg_room`` of the leg from a to b is ``room`` m or more; ends where it is not."""
    length = np.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
    steps = int(length * inverse_resolution) + 1
    for k in range(steps + 1):
        u = k / steps
        here = sample_field(distance, inverse_resolution, ax + u * (bx - ax), ay + u * (by - ay))
        if here - 0.5 / inverse_resolution < room:
            return False
    return True


@kernel()
def simplify_path(path, room, distance, inverse_resolution, comfort):
    """Indices of the points of ``path`` (k, 2) that straight legs need; ``room`` (k,) (m)."""
    count = len(path)
    kept = [0]
    here = 0
    least = np.empty(count)  # from ``here`` on
    while here < count - 1:
        lowest = comfort
        for i in range(here, count):
            lowest = min(lowest, room[i])
            least[i] = lowest
        there = count - 1
        # A straight leg cuts between lattice points: half a cell of slack.
        while there > here + 1 and not leg_keeps(
            distance,
            inverse_resolution,
            path[here, 0],
            path[here, 1],
            path[there, 0],
            path[there, 1],
            least[there] - 0.5 / inverse_resolution,
        ):
            there -= 1
        kept.append(there)
        here = there
    return np.array(kept)
