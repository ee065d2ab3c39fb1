"""People and tasks for a place that only has walls: who walks where, what the robot is asked.

Regions are boxes of free floor that reach every corner; routes are shortest paths between them
that keep off the walls; tasks are pairs of regions at the wanted distance without long detours.
Everything follows from the grid alone, so it is the same on every machine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.maps.pairs import Pair, far_nodes, pair_boxes, wide_parts
from lndrl.maps.paths import Roadmap, path_length
from lndrl.maps.regions import centre, spread_boxes
from lndrl.scenario import Box, Pedestrians, Point, RobotTask, Route
from lndrl.wording import people as crowd
from lndrl.wording import span

PEDESTRIAN_ROOM = 0.3  # m of free room around a pedestrian's start and goal
ROBOT_MARGIN = 0.1  # m of free room around the robot at its start and goal
COMFORT = 0.7  # m to a wall that paths of pedestrians prefer where there is the room
_LEG_ROOM = 0.5  # m that straight legs between waypoints keep, or as much as the path does
TASK_DISTANCE = (11.0, 13.0)  # m between start and goal, as in the paper (parameters §4.7)

_FLOOR_PER_REGION = 30.0  # m²
_FLOOR_PER_PERSON = 6.0  # m²; denser crowds than the paper's only push
_REGION_SIDE = 2.0  # m
_SHORTEST_ROUTE = 4.0  # m
_SHORTEST_WALK = 2.0  # m, where the map offers no such route
_MOST_SHORT_ROUTES = 6
_DETOURS = (1.1, 1.2, 1.3, 1.5)  # of ways to goals; the least that leaves enough to choose from
_FAR = 3.0  # straight lines; the farthest that the robot's ways are searched
_MOST_TASKS = 12
_SHORTEST_TASK = 2.0  # m
_SIDES = (_REGION_SIDE, 1.0, 0.0)  # m; the smaller where the larger offer no such distance

Floats = NDArray[np.float64]


def find_people(
    people: Pedestrians, distance: NDArray[np.float32], resolution: float
) -> tuple[Pedestrians, str]:
    """``people`` with routes between free regions, and a note where the map is small for them.

    Routes are 4 m or longer, or as near to that as the map offers. The count of people shrinks to
    one for every 6 m² of floor, to none where no route can be found.
    """
    if people.routes or people.count[1] == 0:
        return people, ""
    roadmap = Roadmap.build(distance, resolution, PEDESTRIAN_ROOM, COMFORT)
    floor = float((distance > PEDESTRIAN_ROOM).sum()) * resolution**2
    boxes = spread_boxes(
        roadmap, PEDESTRIAN_ROOM, int(np.clip(floor / _FLOOR_PER_REGION, 4, 14)), _REGION_SIDE
    )
    routes, notes = _routes_between(roadmap, boxes), []
    reason = f"{floor:.0f} m² of floor"
    if not routes:
        routes = _short_routes(roadmap)
        reason = reason if routes else f"no two free places {_SHORTEST_WALK:g} m apart"
        shortest = min((_length(route) for route in routes), default=_SHORTEST_ROUTE)
        if shortest < _SHORTEST_ROUTE:
            notes.append(
                f"routes of people from {shortest:.1f} m on: the map offers few of "
                f"{_SHORTEST_ROUTE:g} m"
            )
    most = int(floor / _FLOOR_PER_PERSON) if routes else 0
    count = (min(people.count[0], most), min(people.count[1], most))
    if count != people.count:
        notes.append(f"{crowd(count)} instead of {crowd(people.count)}: {reason}")
    return people.model_copy(update={"routes": routes, "count": count}), "; ".join(notes)


def _length(route: Route) -> float:
    """Metres from the middle of a route's start along its waypoints to that of its goal."""
    return path_length(np.array([centre(route.start), *route.via, centre(route.goal)]))


def find_tasks(
    distance: NDArray[np.float32],
    resolution: float,
    robot_radius: float,
    wanted: tuple[float, float] | None,
    name: str,
    searching: bool = True,
) -> tuple[list[RobotTask], tuple[float, float], str]:
    """Tasks for the robot, their start-goal distance (m), and a note where that had to shrink.

    ``wanted`` None stands for 11 to 13 m or as near to that as the map offers. Regions that
    spread over the floor come first; where no two of them are at the distance, and ``searching``,
    others are looked for that are. Raises UserError naming the scenario when the floor is too
    small, or offers nothing at the ``wanted`` distance.
    """
    room = robot_radius + ROBOT_MARGIN
    roadmap = Roadmap.build(distance, resolution, room, COMFORT)
    floor = float((distance > room).sum()) * resolution**2
    boxes = spread_boxes(roadmap, room, int(np.clip(floor / 12.0, 8, 30)), _REGION_SIDE)
    centres = _centres(boxes)
    straight = np.hypot(*(centres[:, None] - centres[None]).transpose(2, 0, 1))
    limits, note = wanted or TASK_DISTANCE, ""
    pairs = _pairs_within(straight, limits)
    longest = float(straight.max(initial=0.0))
    if not pairs and wanted is None and _SHORTEST_TASK <= longest <= limits[0]:
        limits, pairs = _shrunk(straight)
        note = _shrink_note(limits, far_nodes(roadmap, 0)[1])
    if pairs:
        return _choose_tasks(roadmap, boxes, straight, pairs), limits, note
    found = _search_tasks(roadmap, room, boxes, wanted) if searching else None
    if found is None:
        raise UserError(f"scenario {name}: {_no_tasks(roadmap, room, wanted)}")
    return found


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


def _short_routes(roadmap: Roadmap) -> list[Route]:
    """Routes between the ends of a floor that has no two regions with a way of 4 m; [] for none."""
    if not len(roadmap.nodes):
        return []
    ends, reach = far_nodes(roadmap, 0)
    if reach < _SHORTEST_WALK:
        return []
    limits = (0.75 * reach, reach)
    routes = []
    for pair in _first_pairs(roadmap, ends, limits, PEDESTRIAN_ROOM, _MOST_SHORT_ROUTES):
        via = plan_via(roadmap, pair.start, pair.goal)
        if via is not None:
            routes.append(Route(start=pair.start, goal=pair.goal, via=via))
    return routes[:_MOST_SHORT_ROUTES]


def _first_pairs(
    roadmap: Roadmap, seeds: NDArray[np.intp], limits: tuple[float, float], room: float, most: int
) -> list[Pair]:
    """Pairs of the largest regions that offer some at the distance (see ``pair_boxes``)."""
    for side in _SIDES:
        pairs = pair_boxes(roadmap, seeds, limits, room, side, most)
        if pairs:
            return pairs
    return []


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


def _shrunk(straight: Floats) -> tuple[tuple[float, float], list[tuple[int, int]]]:
    """The largest distances between regions that there are, to 0.1 m, and the pairs at them."""
    longest = float(straight.max())
    limits = (round(0.75 * longest, 1), round(longest, 1))
    if not _pairs_within(straight, limits):  # rounded below the only pair
        limits = _outwards(limits[0], longest)
    return limits, _pairs_within(straight, limits)


def _outwards(least: float, most: float) -> tuple[float, float]:
    """Limits to 0.1 m that hold both distances."""
    return float(np.floor(10.0 * least)) / 10.0, float(np.ceil(10.0 * most)) / 10.0


def _shrink_note(limits: tuple[float, float], reach: float) -> str:
    least = TASK_DISTANCE[0]
    reason = "the map offers no" if reach < least else "none of its free regions lie"
    return f"start and goal {span(*limits)} m apart: {reason} {least:g} m"


def _search_tasks(
    roadmap: Roadmap, room: float, boxes: list[Box], wanted: tuple[float, float] | None
) -> tuple[list[RobotTask], tuple[float, float], str] | None:
    """What ``find_tasks`` returns, by pairs of regions that are made for the distance.

    The first connected part, the largest before others, that offers some; smaller regions only
    where larger ones do not do. None where there are none.
    """
    limits = wanted or TASK_DISTANCE
    for part in wide_parts(roadmap, limits[0]):
        tasks = _tasks_in(roadmap, part, room, boxes, limits)
        if tasks:
            return tasks, limits, ""
    if wanted is not None or not len(roadmap.nodes):
        return None
    reach = far_nodes(roadmap, 0)[1]
    limits = _outwards(0.75 * reach, reach)
    tasks = _tasks_in(roadmap, 0, room, boxes, limits) if reach >= _SHORTEST_TASK else []
    return (tasks, limits, _shrink_note(limits, reach)) if tasks else None


def _tasks_in(
    roadmap: Roadmap, part: int, room: float, boxes: list[Box], limits: tuple[float, float]
) -> list[RobotTask]:
    """Up to twelve tasks in one connected part, those with little detour if there are enough."""
    outermost, reach = far_nodes(roadmap, part)
    if reach < limits[0]:
        return []
    if part != 0:
        boxes = spread_boxes(roadmap, room, 8, _REGION_SIDE, part)
    seeds = np.concatenate([roadmap.nearest(_centres(boxes)), outermost])
    pairs = _first_pairs(roadmap, seeds, limits, room, _MOST_TASKS)
    for most in _DETOURS:
        straight = [pair for pair in pairs if pair.detour <= most]
        if len(straight) >= _MOST_TASKS:
            break
    straight = straight or sorted(pairs, key=lambda pair: pair.detour)[:3]
    return [RobotTask(start=pair.start, goal=pair.goal) for pair in straight[:_MOST_TASKS]]


def _no_tasks(roadmap: Roadmap, room: float, wanted: tuple[float, float] | None) -> str:
    """Why there are none, in a sentence."""
    if not len(roadmap.nodes):
        return (
            f"the map has no free place with {room:.2f} m of room around the robot; check its "
            "resolution and thresholds"
        )
    offers = f"its largest connected floor offers up to {far_nodes(roadmap, 0)[1]:.1f} m"
    if wanted is None:
        return (
            f"no connected start and goal that are {_SHORTEST_TASK:g} m apart or more; {offers}; "
            "check its resolution, or give start_goal_distance"
        )
    return (
        f"no connected start and goal that are {span(*wanted)} m apart; {offers}; "
        "change start_goal_distance"
    )


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
    array = np.array(boxes, np.float64).reshape(-1, 4)
    return 0.5 * (array[:, :2] + array[:, 2:])
