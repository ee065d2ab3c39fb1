"""A driver that tours a place: random goals, shortest paths with clearance, pure pursuit.

It steers by the true pose, so that what it drives does not depend on any filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from lndrl.maps.raycast import sample_field
from lndrl.randomness import State, uniform
from lndrl.world import Place
from lndrl.world.odometry import drive

Floats = NDArray[np.float64]

V_MAX = 0.6  # m/s, the task's fastest action
W_MAX = 0.9  # rad/s
STEP = 0.2  # m, cells of the routes' grid
WALL_GAP = 0.12  # m, at least this far from walls on a route, beyond the robot's radius
ROOMY = 0.8  # m; routes prefer as much room to walls
LOOK_AHEAD = 0.8  # m along the route to the point that is pursued
NEAR_GOAL = 0.5  # m
FARTHER = 4.0  # m, a new goal is at least this far away
PEOPLE_GAP = 0.75  # m between centres: radius, a leg's swing and a hand's breadth
PATIENCE = 8.0  # s without headway until the goal is given up
_HEADWAY = 0.4  # m
_TURN_ON_THE_SPOT = 0.9  # rad
_FORESIGHT = (0.4, 0.8, 1.2)  # s
_TRIES = 200


@dataclass(frozen=True, eq=False)
class RouteMap:
    """A coarse grid of where the robot can go, with the cost of every step; one per place.

    ``nodes`` ``(n, 2)`` are free points (m), ``graph`` costs between neighbours, ``parts`` (n,)
    the connected part that each belongs to.
    """

    nodes: Floats
    graph: coo_matrix
    parts: NDArray[np.int32]

    @classmethod
    def build(cls, place: Place) -> RouteMap:
        """Sample ``place`` every ``STEP`` m; near walls steps cost up to four times as much."""
        width, height = place.grid.size
        ys, xs = np.mgrid[0.5 * STEP : height : STEP, 0.5 * STEP : width : STEP]
        rows = np.minimum((ys / place.grid.resolution).astype(int), place.distance.shape[0] - 1)
        columns = np.minimum((xs / place.grid.resolution).astype(int), place.distance.shape[1] - 1)
        room = place.distance[rows, columns].astype(np.float64) - 0.5 * place.grid.resolution
        free = room >= place.robot_radius + WALL_GAP
        number = np.full(free.shape, -1)
        number[free] = np.arange(free.sum())
        cost = 1.0 + 3.0 * np.clip(1.0 - room / ROOMY, 0.0, 1.0)
        edges = [
            _edges(number, cost, down, right) for down, right in ((0, 1), (1, 0), (1, 1), (1, -1))
        ]
        start, end, weight = (np.concatenate(column) for column in zip(*edges, strict=True))
        count = int(free.sum())
        graph = coo_matrix((weight, (start, end)), shape=(count, count)).tocsr()
        _, parts = connected_components(graph, directed=False)
        return cls(np.stack([xs[free], ys[free]], axis=1), graph, parts)

    def nearest(self, point: Floats) -> int:
        """The node nearest to ``point`` (2,) in m."""
        return int(np.argmin(((self.nodes - point) ** 2).sum(axis=1)))

    def toward(self, goal: int) -> NDArray[np.int32]:
        """For every node the next one on the cheapest way to ``goal``; negative where none is."""
        _, following = dijkstra(self.graph, directed=False, indices=goal, return_predecessors=True)
        return np.asarray(following, dtype=np.int32)


def _edges(
    number: NDArray[np.int64], cost: Floats, down: int, right: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Edges from every cell to the one ``down`` rows and ``right`` columns on, if both are free."""
    rows, columns = number.shape
    left, end = max(0, -right), columns - max(0, right)
    a = np.s_[: rows - down, left:end]
    b = np.s_[down:, left + right : end + right]
    both = (number[a] >= 0) & (number[b] >= 0)
    if down and right:
        # No cutting of corners: the two cells beside a diagonal must be free as well.
        both &= (number[: rows - down, left + right : end + right] >= 0) & (
            number[down:, left:end] >= 0
        )
    weight = math.hypot(down, right) * STEP * 0.5 * (cost[a] + cost[b])
    return number[a][both], number[b][both], weight[both]


class Tour:
    """Drives from one random goal to the next, around people where there is room.

    ``goals_reached`` and ``goals_given_up`` count since the start. ``period`` (s) is how long a
    command lasts; ``state`` (uint64[4], advanced in place) draws the goals.
    """

    def __init__(self, place: Place, routes: RouteMap, period: float, state: State) -> None:
        self.goals_reached = 0
        self.goals_given_up = 0
        self._place = place
        self._routes = routes
        self._period = period
        self._state = state
        self._goal = -1
        self._following: NDArray[np.int32] = np.zeros(0, np.int32)
        self._anchor = np.zeros(2)
        self._waited = 0.0

    def command(self, pose: Floats, people: Floats, velocity: Floats) -> tuple[float, float]:
        """v (m/s) and w (rad/s) for the coming period.

        ``pose`` [x, y, yaw] (m, rad) is the truth, ``people`` and ``velocity`` ``(P, 2)`` in m
        and m/s, map frame.
        """
        self._watch_goal(pose)
        wanted = self._pursue(pose, LOOK_AHEAD)
        if not self._clear_of_walls(pose, *wanted):
            wanted = self._pursue(pose, 0.5 * LOOK_AHEAD)
        near = np.hypot(*(people - pose[:2]).T) < 3.0
        return self._first_safe(pose, wanted, people[near], velocity[near])

    def _watch_goal(self, pose: Floats) -> None:
        """Choose a new goal at the start, at the goal, and where there is no headway."""
        if np.hypot(*(pose[:2] - self._anchor)) > _HEADWAY:
            self._anchor = pose[:2].copy()
            self._waited = 0.0
        self._waited += self._period
        if self._goal >= 0:
            left = float(np.hypot(*(self._routes.nodes[self._goal] - pose[:2])))
            arrived = left < NEAR_GOAL
            if not arrived and self._waited < PATIENCE:
                return
            self.goals_reached += arrived
            self.goals_given_up += not arrived
        self._waited = 0.0
        self._goal = self._draw_goal(pose)
        self._following = self._routes.toward(self._goal)

    def _draw_goal(self, pose: Floats) -> int:
        routes = self._routes
        here = routes.parts[routes.nearest(pose[:2])]
        reachable = np.flatnonzero(routes.parts == here)
        gaps = np.hypot(*(routes.nodes[reachable] - pose[:2]).T)
        for _ in range(_TRIES):
            i = int(uniform(self._state) * len(reachable))
            if gaps[i] >= FARTHER:
                return int(reachable[i])
        return int(reachable[np.argmax(gaps)])

    def _pursue(self, pose: Floats, reach: float) -> tuple[float, float]:
        """Pure pursuit of the point ``reach`` m ahead on the route; turns on the spot first."""
        nodes = self._routes.nodes
        at = self._routes.nearest(pose[:2])
        while np.hypot(*(nodes[at] - pose[:2])) < reach and self._following[at] >= 0:
            at = int(self._following[at])
        dx, dy = nodes[at] - pose[:2]
        bearing = (math.atan2(dy, dx) - pose[2] + math.pi) % (2.0 * math.pi) - math.pi
        if abs(bearing) > _TURN_ON_THE_SPOT:
            return 0.0, math.copysign(W_MAX, bearing)
        gap = math.hypot(dx, dy)
        curvature = 2.0 * math.sin(bearing) / max(gap, 0.1)
        v = min(V_MAX, W_MAX / max(abs(curvature), 1e-9))
        return v, float(np.clip(v * curvature, -W_MAX, W_MAX))

    def _first_safe(
        self, pose: Floats, wanted: tuple[float, float], people: Floats, velocity: Floats
    ) -> tuple[float, float]:
        """The first of: as wanted, sidesteps, slower, turning where it stands."""
        v, w = wanted
        turns = (0.0, 0.4, -0.4, 0.8, -0.8)
        for share in (1.0, 0.5):
            for turn in turns if len(people) and v > 0.0 else turns[:1]:
                tried = share * v, float(np.clip(share * w + turn, -W_MAX, W_MAX))
                if self._clear_of_walls(pose, *tried) and _clear_of_people(
                    pose, tried, people, velocity
                ):
                    return tried
        if v > 0.0 and w == 0.0:
            return 0.0, 0.0
        return 0.0, w

    def _clear_of_walls(self, pose: Floats, v: float, w: float) -> bool:
        if v == 0.0:
            return True
        ahead = pose.copy()
        place = self._place
        inverse = 1.0 / place.grid.resolution
        for _ in range(4):
            drive(ahead, v, w, 0.25 * (self._period + 0.2))
            room = sample_field(place.distance, inverse, ahead[0], ahead[1]) - 0.5 / inverse
            if room < place.robot_radius + 0.04:
                return False
        return True


def _clear_of_people(
    pose: Floats, command: tuple[float, float], people: Floats, velocity: Floats
) -> bool:
    """Whether nobody comes closer than ``PEOPLE_GAP``, or than they already are, soon."""
    if not len(people):
        return True
    enough = np.minimum(PEOPLE_GAP, np.hypot(*(people - pose[:2]).T) - 0.01)
    for time in _FORESIGHT:
        ahead = pose.copy()
        drive(ahead, *command, time)
        if (np.hypot(*(people + velocity * time - ahead[:2]).T) < enough).any():
            return False
    return True
