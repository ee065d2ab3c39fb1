"""Who walks where at the start of an episode."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.config import CrowdConfig
from lndrl.randomness import State, uniform
from lndrl.scenario import Route
from lndrl.world.pedestrians import ORCA, SFM, Crowd
from lndrl.world.place import PEDESTRIAN_ROOM, Place, weighted_choice

ROBOT_GAP = 1.0  # m between robot and pedestrians at the start
PEDESTRIAN_GAP = 1.0  # m between pedestrians at the start, where possible
_TRIES = 50

Floats = NDArray[np.float64]


def place_crowd(
    crowd: Crowd, place: Place, config: CrowdConfig, robot: Floats, state: State
) -> None:
    """Draw the crowd of an episode: number, routes, models, and a spot along each route.

    ``robot`` [x, y, ...] (m) keeps ``ROBOT_GAP`` to everybody; pedestrians keep
    ``PEDESTRIAN_GAP`` to each other unless fifty draws find no such spot. All walk at once.
    """
    people = place.scenario.pedestrians
    fewest, most = people.count
    crowd.count = fewest + int(uniform(state) * (most - fewest + 1))
    weights = [route.weight for route in people.routes]
    for i in range(crowd.count):
        path, spot, ahead = _draw_spot(crowd, place, weights, i, robot, state)
        crowd.route[i, : len(path)] = path
        crowd.route_length[i] = len(path)
        crowd.target[i] = ahead
        crowd.direction[i] = 1
        crowd.shuttle[i] = uniform(state) < people.shuttle
        crowd.model[i] = ORCA if uniform(state) < people.orca else SFM
        crowd.position[i] = spot
        step = path[ahead] - spot
        length = float(np.hypot(step[0], step[1]))
        crowd.heading[i] = np.arctan2(step[1], step[0])
        crowd.velocity[i] = step / length * config.max_speed if length > 1e-9 else 0.0
        crowd.travelled[i] = 8.0 * config.step_length * uniform(state)
    crowd.place_legs()


def _draw_spot(
    crowd: Crowd, place: Place, weights: list[float], i: int, robot: Floats, state: State
) -> tuple[Floats, Floats, int]:
    """Path, position and index of the waypoint ahead: the roomiest of the draws tried."""
    best_score = -np.inf
    for _ in range(_TRIES):
        route = place.scenario.pedestrians.routes[weighted_choice(weights, state)]
        path = _draw_path(place, route, state)
        spot, ahead = _point_along(path, uniform(state))
        robot_gap = float(np.hypot(spot[0] - robot[0], spot[1] - robot[1])) - ROBOT_GAP
        others = crowd.position[:i] - spot
        nearest = float(np.hypot(others[:, 0], others[:, 1]).min()) if i else np.inf
        if robot_gap >= 0 and nearest >= PEDESTRIAN_GAP:
            return path, spot, ahead
        # The robot's gap counts first: a start in contact would end the episode at once.
        score = min(robot_gap, 0.0) * 100.0 + nearest
        if score > best_score:
            best_score, best = score, (path, spot, ahead)
    return best


def _draw_path(place: Place, route: Route, state: State) -> Floats:
    start = place.draw_free(route.start, PEDESTRIAN_ROOM, state)
    goal = place.draw_free(route.goal, PEDESTRIAN_ROOM, state)
    assert start is not None and goal is not None  # Place.build has probed both regions
    path = np.array([start, *route.via, goal], dtype=np.float64)
    if route.both_ways and uniform(state) < 0.5:
        path = path[::-1].copy()
    return path


def _point_along(path: Floats, fraction: float) -> tuple[Floats, int]:
    """Point at ``fraction`` of the path's length and the index of the waypoint ahead of it."""
    legs = np.diff(path, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    left = fraction * float(lengths.sum())
    for i, length in enumerate(lengths):
        if left <= length or i == len(lengths) - 1:
            share = min(left / length, 1.0) if length > 0 else 0.0
            return path[i] + share * legs[i], i + 1
        left -= float(length)
    raise AssertionError("a path has at least two points")
