"""People and tasks for a place that only has walls: who walks where, what the robot is asked.

Regions are boxes of free floor that reach every corner; routes are shortest paths between them
that keep off the walls; tasks are pairs of regions at the wanted distance without long detours.
Everything follows from the grid alone, so it is the same on every machine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.maps.paths import Roadmap, path_length
from lndrl.maps.regions import spread_boxes
from lndrl.scenario import Box, Pedestrians, Point, RobotTask, Route

PEDESTRIAN_ROOM = 0.3  # m of free room around a pedestrian's start and goal
ROBOT_MARGIN = 0.1  # m of free room around the robot at its start and goal
COMFORT = 0.7  # m to a wall that paths of pedestrians prefer where there is the room
_LEG_ROOM = 0.5  # m that straight legs between waypoints keep, or as much as the path does
TASK_DISTANCE = (11.0, 13.0)  # m between start and goal, as in the paper (parameters §4.7)

_FLOOR_PER_REGION = 30.0  # m²
_FLOOR_PER_PERSON = 6.0  # m²; denser crowds than the paper's only push
_REGION_SIDE = 2.0  # m
_SHORTEST_ROUTE = 4.0  # m
_DETOURS = (1.1, 1.2, 1.3, 1.5)  # of ways to goals; the least that leaves enough to choose from
_FAR = 3.0  # straight lines; the farthest that the robot's ways are searched
_MOST_TASKS = 12
_SHORTEST_TASK = 2.0  # m

Floats = NDArray[np.float64]


def find_people(
    people: Pedestrians, distance: NDArray[np.float32], resolution: float
) -> tuple[Pedestrians, str]:
    """``people`` with routes between free regions, and a note where the map is small for them.

    Their count shrinks to one for every 6 m² of floor, to none where no route can be found.
    """
    if people.routes or people.count[1] == 0:
        return people, ""
    roadmap = Roadmap.build(distance, resolution, PEDESTRIAN_ROOM, COMFORT)
    floor = float((distance > PEDESTRIAN_ROOM).sum()) * resolution**2
    boxes = spread_boxes(
        roadmap, PEDESTRIAN_ROOM, int(np.clip(floor / _FLOOR_PER_REGION, 4, 14)), _REGION_SIDE
    )
    routes = _routes_between(roadmap, boxes)
    most = int(floor / _FLOOR_PER_PERSON) if routes else 0
    count = (min(people.count[0], most), min(people.count[1], most))
    note = ""
    if count != people.count:
        reason = f"{floor:.0f} m² of floor" if routes else "no two free regions 4 m apart"
        note = f"{count[0]} to {count[1]} people instead of {people.count[0]} to "
        note += f"{people.count[1]}: {reason}"
    return people.model_copy(update={"routes": routes, "count": count}), note


def find_tasks(
    distance: NDArray[np.float32],
    resolution: float,
    robot_radius: float,
    wanted: tuple[float, float] | None,
    name: str,
) -> tuple[list[RobotTask], tuple[float, float], str]:
    """Tasks for the robot, their start-goal distance (m), and a note where that had to shrink.

    ``wanted`` None stands for 11 to 13 m or as near to that as the map offers. Raises UserError
    naming the scenario when the floor is too small, or offers nothing at the ``wanted`` distance.
    """
    room = robot_radius + ROBOT_MARGIN
    roadmap = Roadmap.build(distance, resolution, room, COMFORT)
    floor = float((distance > room).sum()) * resolution**2
    boxes = spread_boxes(roadmap, room, int(np.clip(floor / 12.0, 8, 30)), _REGION_SIDE)
    if len(boxes) < 2:
        raise UserError(
            f"scenario {name}: the map has no two connected free places with {room:.2f} m of "
            "room around the robot; check its resolution and thresholds"
        )
    centres = _centres(boxes)
    straight = np.hypot(*(centres[:, None] - centres[None]).transpose(2, 0, 1))
    limits, note = wanted or TASK_DISTANCE, ""
    pairs = _pairs_within(straight, limits)
    if not pairs:
        longest = float(straight.max())
        if wanted is not None or longest < _SHORTEST_TASK or longest > limits[0]:
            raise UserError(
                f"scenario {name}: no connected start and goal that are {limits[0]:g} to "
                f"{limits[1]:g} m apart; the map offers up to {longest:.1f} m; change "
                "start_goal_distance"
            )
        limits = (round(0.75 * longest, 1), round(longest, 1))
        note = f"start and goal {limits[0]:g} to {limits[1]:g} m apart: the map offers no 11 m"
        pairs = _pairs_within(straight, limits)
    return _choose_tasks(roadmap, boxes, straight, pairs), limits, note


def plan_via(roadmap: Roadmap, start: Box, goal: Box) -> list[Point] | None:
    """Waypoints from box to box that no straight leg leads through a wall; None: no path.

    From every corner of a box the first waypoint can be walked to; where that is not so, the
    box's middle is a waypoint too.
    """
    a, b = _centres([start, goal])
    sources = roadmap.nearest(np.stack([a, b]))
    cost, before = roadmap.search(sources[:1])
    if not np.isfinite(cost[0, sources[1]]):
        return None
    return _waypoints(roadmap, roadmap.trace(before[0], int(sources[1])), start, goal)


def _routes_between(roadmap: Roadmap, boxes: list[Box]) -> list[Route]:
    """Every region is joined with its farthest and with one of middle distance, by path."""
    if len(boxes) < 2:
        return []
    nodes = roadmap.nearest(_centres(boxes))
    cost, before = roadmap.search(nodes)
    between = cost[:, nodes]
    pairs: list[tuple[int, int]] = []
    for i in range(len(boxes)):
        order = np.argsort(between[i], kind="stable")[1:]
        for j in (int(order[-1]), int(order[len(order) // 2])):
            pair = (min(i, j), max(i, j))
            if pair not in pairs and np.isfinite(between[i, j]):
                pairs.append(pair)
    routes = []
    for i, j in pairs:
        path = roadmap.trace(before[i], int(nodes[j]))
        if path_length(path) >= _SHORTEST_ROUTE:
            via = _waypoints(roadmap, path, boxes[i], boxes[j])
            routes.append(Route(start=boxes[i], goal=boxes[j], via=via))
    return routes


def _waypoints(roadmap: Roadmap, path: Floats, start: Box, goal: Box) -> list[Point]:
    legs = roadmap.simplify(path, _LEG_ROOM)
    inner = list(legs[1:-1])
    # The path's ends are the boxes' middles; drop them where all of a box sees the next point.
    if not _all_see(roadmap, start, inner[0] if inner else legs[-1], goal if not inner else None):
        inner.insert(0, legs[0])
    if not _all_see(roadmap, goal, inner[-1] if inner else legs[0], start if not inner else None):
        inner.append(legs[-1])
    return [(round(float(x), 2), round(float(y), 2)) for x, y in inner]


def _all_see(roadmap: Roadmap, box: Box, point: Floats, other: Box | None) -> bool:
    """Whether straight legs lead from all of ``box`` to ``point``, or to all of ``other``."""
    targets = _lattice(other) if other is not None else [point]
    return all(roadmap.sees(a, b, PEDESTRIAN_ROOM - 0.05) for a in _lattice(box) for b in targets)


def _lattice(box: Box) -> list[Floats]:
    return [np.array([x, y]) for x in np.linspace(*box[::2], 3) for y in np.linspace(*box[1::2], 3)]


def _pairs_within(straight: Floats, limits: tuple[float, float]) -> list[tuple[int, int]]:
    """Pairs of regions whose middles are at the distance, those nearest to its middle first."""
    a, b = np.nonzero(np.triu((straight >= limits[0]) & (straight <= limits[1]), 1))
    off = np.abs(straight[a, b] - 0.5 * (limits[0] + limits[1]))
    return [(int(a[k]), int(b[k])) for k in np.argsort(off, kind="stable")]


def _choose_tasks(
    roadmap: Roadmap, boxes: list[Box], straight: Floats, pairs: list[tuple[int, int]]
) -> list[RobotTask]:
    """The pairs with little detour, every region as often as any other."""
    nodes = roadmap.nearest(_centres(boxes))
    # On a large map a search of everything takes long, and longer ways are wanted by nobody.
    cost, before = roadmap.search(nodes, _FAR * max(straight[a, b] for a, b in pairs))
    near = [(a, b) for a, b in pairs if np.isfinite(cost[a, nodes[b]])]
    if not near:
        _, before = roadmap.search(nodes)
        near = pairs
    detour = {
        (a, b): path_length(roadmap.trace(before[a], int(nodes[b]))) / straight[a, b]
        for a, b in near
    }
    pairs = near
    left: list[tuple[int, int]] = []
    for most in _DETOURS:
        if len(left) < _MOST_TASKS:
            left = [pair for pair in pairs if detour[pair] <= most]
    left = left or sorted(pairs, key=lambda pair: detour[pair])[:3]
    used = np.zeros(len(boxes), np.int64)
    tasks: list[RobotTask] = []
    while left and len(tasks) < _MOST_TASKS:
        a, b = min(left, key=lambda pair: int(used[pair[0]] + used[pair[1]]))
        left.remove((a, b))
        used[[a, b]] += 1
        tasks.append(RobotTask(start=boxes[a], goal=boxes[b]))
    return tasks


def _centres(boxes: list[Box]) -> Floats:
    array = np.array(boxes, np.float64)
    return 0.5 * (array[:, :2] + array[:, 2:])
