"""Who walks where at the start of an episode, in one compiled call."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lndrl.kernels import kernel
from lndrl.randomness import uniform
from lndrl.scenario import Pedestrians
from lndrl.world.pedestrians import ORCA, SFM
from lndrl.world.place import PEDESTRIAN_ROOM, draw_free

ROBOT_GAP = 1.0  # m between robot and pedestrians at the start
PEDESTRIAN_GAP = 1.0  # m between pedestrians at the start, where possible
_TRIES = 50
_REGION_TRIES = 2000

Floats = NDArray[np.float64]


class Routes(NamedTuple):
    """A scenario's crowd as arrays: R routes with up to W waypoints each (m, map frame)."""

    start: Floats  # (R, 4) x_min, y_min, x_max, y_max
    goal: Floats  # (R, 4)
    via: Floats  # (R, W, 2)
    vias: NDArray[np.int64]  # (R,)
    weight: Floats  # (R,)
    both_ways: NDArray[np.bool_]  # (R,)
    fewest: int
    most: int
    orca: float
    shuttle: float


def make_routes(people: Pedestrians) -> Routes:
    """The arrays of ``people``; a scenario without pedestrians has no routes."""
    routes = people.routes
    via = np.zeros((len(routes), max((len(r.via) for r in routes), default=0), 2))
    for i, route in enumerate(routes):
        if route.via:
            via[i, : len(route.via)] = route.via
    return Routes(
        start=np.array([r.start for r in routes], dtype=np.float64).reshape(-1, 4),
        goal=np.array([r.goal for r in routes], dtype=np.float64).reshape(-1, 4),
        via=via,
        vias=np.array([len(r.via) for r in routes], dtype=np.int64),
        weight=np.array([r.weight for r in routes], dtype=np.float64),
        both_ways=np.array([r.both_ways for r in routes], dtype=np.bool_),
        fewest=int(people.count[0]),
        most=int(people.count[1]),
        orca=float(people.orca),
        shuttle=float(people.shuttle),
    )


@kernel()
def _choose_route(weight, state):
    left = uniform(state) * weight.sum()
    for i in range(len(weight)):
        left -= weight[i]
        if left < 0.0:
            return i
    return len(weight) - 1


@kernel()
def _draw_path(routes, r, distance, inverse_resolution, state, path):
    """Write a way along route ``r`` to ``path`` (W + 2, 2); returns its number of points."""
    length = min(routes.vias[r] + 2, len(path))
    reverse = routes.both_ways[r] and uniform(state) < 0.5
    for end in range(2):
        box = routes.start[r] if end == 0 else routes.goal[r]
        x, y = draw_free(
            distance, inverse_resolution, box[0], box[1], box[2], box[3],
            PEDESTRIAN_ROOM, state, _REGION_TRIES,
        )  # fmt: skip
        at = length - 1 if (end == 1) != reverse else 0
        path[at, 0] = x
        path[at, 1] = y
    for k in range(length - 2):
        at = length - 2 - k if reverse else k + 1
        path[at, 0] = routes.via[r, k, 0]
        path[at, 1] = routes.via[r, k, 1]
    return length


@kernel()
def point_along(path, length, fraction):
    """Point (x, y) at ``fraction`` of a path of ``length`` points, and the index ahead of it."""
    whole = 0.0
    for i in range(length - 1):
        whole += np.hypot(path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1])
    left = fraction * whole
    for i in range(length - 1):
        dx = path[i + 1, 0] - path[i, 0]
        dy = path[i + 1, 1] - path[i, 1]
        leg = np.hypot(dx, dy)
        if left <= leg or i == length - 2:
            share = min(left / leg, 1.0) if leg > 0.0 else 0.0
            return path[i, 0] + share * dx, path[i, 1] + share * dy, i + 1
        left -= leg
    return path[0, 0], path[0, 1], 1


@kernel()
def _score(people, i, x, y, robot):
    """How good a spot is for person ``i``: 0 where everybody keeps the gaps, else less."""
    nearest = PEDESTRIAN_GAP
    for other in range(i):
        gap = np.hypot(people.position[other, 0] - x, people.position[other, 1] - y)
        nearest = min(nearest, gap)
    robot_gap = min(np.hypot(x - robot[0], y - robot[1]) - ROBOT_GAP, 0.0)
    # The robot's gap counts first: a start in contact would end the episode at once.
    return 100.0 * robot_gap + (nearest - PEDESTRIAN_GAP)


@kernel()
def place_people(people, routes, distance, inverse_resolution, robot, max_speed, gait, state):
    """Draw the crowd of an episode: number, routes, models, and a spot along each route.

    ``people`` is one world's ``People``; ``distance`` the map's field (m); ``robot`` [x, y, ...]
    (m) keeps ``ROBOT_GAP`` to everybody; people keep ``PEDESTRIAN_GAP`` to each other unless fifty
    draws find no such spot: then the roomiest of them. All walk at once with ``max_speed`` (m/s),
    somewhere in a cycle of ``gait`` metres.
    """
    count = routes.fewest + int(uniform(state) * (routes.most - routes.fewest + 1))
    people.count[0] = min(count, len(people.heading)) if len(routes.weight) > 0 else 0
    path = np.empty((people.route.shape[1], 2))
    for i in range(people.count[0]):
        best = -np.inf
        for _ in range(_TRIES):
            r = _choose_route(routes.weight, state)
            length = _draw_path(routes, r, distance, inverse_resolution, state, path)
            x, y, ahead = point_along(path, length, uniform(state))
            score = _score(people, i, x, y, robot)
            if score > best:
                best = score
                # Not one slice to another: numba compiles 2 s longer for the text of its error.
                for k in range(length):
                    people.route[i, k, 0] = path[k, 0]
                    people.route[i, k, 1] = path[k, 1]
                people.route_length[i] = length
                people.target[i] = ahead
                people.position[i, 0] = x
                people.position[i, 1] = y
            if score >= 0.0:
                break
        people.direction[i] = 1
        people.shuttle[i] = uniform(state) < routes.shuttle
        people.model[i] = ORCA if uniform(state) < routes.orca else SFM
        ahead = people.target[i]
        dx = people.route[i, ahead, 0] - people.position[i, 0]
        dy = people.route[i, ahead, 1] - people.position[i, 1]
        way = np.hypot(dx, dy)
        people.heading[i] = np.arctan2(dy, dx)
        people.velocity[i, 0] = dx / way * max_speed if way > 1e-9 else 0.0
        people.velocity[i, 1] = dy / way * max_speed if way > 1e-9 else 0.0
        people.travelled[i] = gait * uniform(state)
