"""A place: a scenario with everything that is computed from it once per process."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from lndrl.config import TaskConfig, WorldConfig
from lndrl.errors import UserError
from lndrl.kernels import expect, kernel
from lndrl.maps.edges import RayMap, ray_map
from lndrl.maps.embedded import unpack, with_map
from lndrl.maps.floors import edge_note, floor_around
from lndrl.maps.grid import OccupancyGrid, distance_field, grid_from_scenario
from lndrl.maps.outlines import Outline, geometry_outlines, grid_outlines, segments
from lndrl.maps.paths import Roadmap, leg_keeps
from lndrl.maps.raycast import clearance, sample_field
from lndrl.maps.regions import centre
from lndrl.randomness import State, stream_state, uniform
from lndrl.scenario import Box, Point, RobotTask, Route, Scenario
from lndrl.wording import span
from lndrl.world.furnish import (
    COMFORT,
    PEDESTRIAN_ROOM,
    ROBOT_MARGIN,
    find_people,
    find_tasks,
    plan_via,
)
from lndrl.world.layouts import generate, place_of
from lndrl.world.orca_walls import Walls, index_edges, insert_edges, wall_edges

_TRIES = 2000
_ANY_DISTANCE = (0.0, np.inf)

Start = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Place:
    """A validated scenario with its grid, distance field and wall outlines.

    Everything lies in a frame of its own with (0, 0) at the grid's lower left corner;
    ``map_origin`` is that corner in the frame of the map (m), (0, 0) but for ROS maps, so
    ``map_origin + point`` is where a person finds the point in the map. ``scenario`` is the one
    that worlds play: people and tasks are filled in where a map or a random layout left them to
    be found, and its regions lie in the place's frame.

    ``distance`` float32 ``(h, w)`` (m, centre to centre), ``cells`` the same in whole cells
    (uint8), ``rays`` what the laser needs; ``outlines`` closed polygons (n, 2) (m) of everything
    solid, solid on the left of each edge, circles as polygons; ``walls`` ``(S, 4)`` their edges
    [x0, y0, x1, y1] (m); ``regions`` uint16 ``(h, w)`` numbers the connected areas that the
    robot's centre can move in, 0 where it does not fit. ``arrive_distance`` (m) is what the goal
    counts as reached within; no episode starts there. ``notes`` say what had to give way.
    """

    scenario: Scenario
    grid: OccupancyGrid
    distance: NDArray[np.float32]
    cells: NDArray[np.uint8]
    rays: RayMap
    walls: NDArray[np.float64]
    regions: NDArray[np.uint16]
    robot_radius: float
    arrive_distance: float
    outlines: tuple[Outline, ...] = ()
    map_origin: Point = (0.0, 0.0)
    notes: tuple[str, ...] = ()
    _solid: dict[float, Walls] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def build(
        cls,
        scenario: Scenario,
        robot_radius: float | None = None,
        layout: int = 0,
        arrive_distance: float | None = None,
    ) -> Place:
        """Rasterise and validate ``scenario`` for a robot of ``robot_radius`` m that arrives
        within ``arrive_distance`` m of its goal (defaults: the configuration's); ``layout`` picks
        one of a random or mixed scenario's.

        Raises UserError (scenario, region, mend) when a region leaves the map or has no free
        room, when a robot task has no connected start and goal at ``start_goal_distance`` and
        farther apart than ``arrive_distance``, and for what is wrong with a map.
        """
        expect(draw_free, insert_edges, leg_keeps)
        radius = WorldConfig().robot_radius if robot_radius is None else robot_radius
        arrive = TaskConfig().arrive_distance if arrive_distance is None else arrive_distance
        scenario, layout = place_of(scenario, layout)
        if scenario.kind == "random":
            scenario = generate(scenario, layout, radius)
        origin: Point = (0.0, 0.0)
        if scenario.kind == "map":
            scenario = with_map(scenario)
            grid = unpack(scenario)
            origin = grid.origin
            grid = replace(grid, origin=(0.0, 0.0))
            scenario = _moved(scenario, (-origin[0], -origin[1]))
            outlines = grid_outlines(grid)
        else:
            grid = grid_from_scenario(scenario)
            outlines = geometry_outlines(scenario)
        distance = distance_field(grid.occupied, grid.resolution)
        regions, count = label(distance > radius + 0.5 * grid.resolution)
        if count > np.iinfo(np.uint16).max:
            raise UserError(
                f"scenario {scenario.name}: its floor falls into {count:,} pieces; clean the map"
            )
        notes: tuple[str, ...] = ()
        if scenario.kind == "map":
            scenario, notes = _furnished(scenario, grid, distance, regions, radius, origin)
            notes = (*scenario.map_notes, *notes)
        cells = clearance(distance, grid.resolution)
        place = cls(
            scenario,
            grid,
            distance,
            cells,
            ray_map(grid, cells),
            segments(outlines),
            regions.astype(np.uint16),
            radius,
            arrive,
            outlines,
            origin,
            notes,
        )
        place._check()
        return replace(place, scenario=_with_ways(place))

    def __deepcopy__(self, memo: dict[int, Any]) -> Place:
        return self  # never changed, and megabytes

    def solid(self, reach: float) -> Walls:
        """The outlines' edges by the tiles from where they can be within ``reach`` m.

        Made once for each ``reach`` and shared by all worlds here; never write to it.
        """
        if reach not in self._solid:
            made = next(iter(self._solid.values()), None)
            edges = wall_edges(self.outlines) if made is None else made.edges
            self._solid[reach] = index_edges(edges, reach)
        return self._solid[reach]

    def room(self, x: float, y: float) -> float:
        """Metres from the point to the nearest wall, to within a cell; 0 outside."""
        resolution = self.grid.resolution
        field = sample_field(self.distance, 1.0 / resolution, x, y)
        return max(0.0, float(field) - 0.5 * resolution)

    def draw_free(self, box: Box, room: float, state: State) -> Start | None:
        """Uniform point of ``box`` with ``room`` m to every wall; None after many tries."""
        x, y = draw_free(
            self.distance, 1.0 / self.grid.resolution, *map(float, box), room, state, _TRIES
        )
        return None if np.isnan(x) else (x, y)

    def draw_task(self, state: State) -> tuple[Start, Start]:
        """Start and goal (m) of an episode: connected, free, at ``start_goal_distance``, and not
        within ``arrive_distance`` of each other.

        Raises UserError when none is found; ``build`` has checked that this is no rule.
        """
        tasks = self.scenario.robot
        task = tasks[weighted_choice([t.weight for t in tasks], state)]
        swap = task.both_ways and uniform(state) < 0.5
        pair = self._draw_pair(task, state)
        if pair is None:
            raise UserError(self._no_pair(tasks.index(task)))
        return (pair[1], pair[0]) if swap else pair

    def _draw_pair(self, task: RobotTask, state: State) -> tuple[Start, Start] | None:
        room = self.robot_radius + ROBOT_MARGIN
        nearest, farthest = self.scenario.start_goal_distance or _ANY_DISTANCE
        for _ in range(_TRIES):
            start = self.draw_free(task.start, room, state)
            goal = self.draw_free(task.goal, room, state)
            if start is None or goal is None:
                return None
            distance = float(np.hypot(goal[0] - start[0], goal[1] - start[1]))
            far_enough = nearest <= distance and self.arrive_distance <= distance
            if far_enough and distance <= farthest and self._connected(start, goal):
                return start, goal
        return None

    def _connected(self, start: Start, goal: Start) -> bool:
        here = self.regions[self.grid.index(*start)]
        return bool(here != 0 and here == self.regions[self.grid.index(*goal)])

    def _check(self) -> None:
        state = stream_state(0)
        robot_room = self.robot_radius + ROBOT_MARGIN
        for i, task in enumerate(self.scenario.robot):
            self._check_region(f"robot.{i}.start", task.start, robot_room, state)
            self._check_region(f"robot.{i}.goal", task.goal, robot_room, state)
            if self._draw_pair(task, state) is None:
                raise UserError(self._no_pair(i))
        for i, route in enumerate(self.scenario.pedestrians.routes):
            where = f"pedestrians.routes.{i}"
            self._check_region(f"{where}.start", route.start, PEDESTRIAN_ROOM, state)
            self._check_region(f"{where}.goal", route.goal, PEDESTRIAN_ROOM, state)
            for point in route.via:
                if self.room(*point) <= 0.0:
                    raise UserError(
                        f"scenario {self.scenario.name}: {where}.via {self._shown(point)} lies in "
                        "a wall or off the map; move it to free floor"
                    )

    def _check_region(self, where: str, box: Box, room: float, state: State) -> None:
        name = self.scenario.name
        width, height = self.grid.size
        x_min, y_min, x_max, y_max = box
        if not (x_min <= x_max and y_min <= y_max):
            raise UserError(
                f"scenario {name}: {where} {self._shown(box)} must be [x_min, y_min, x_max, y_max]"
            )
        slack = 1e-6  # a shifted map has rounded
        if min(x_min, y_min) < -slack or x_max > width + slack or y_max > height + slack:
            raise UserError(
                f"scenario {name}: {where} {self._shown(box)} leaves the map; "
                f"it must lie in {self._shown((0.0, 0.0, width, height))}"
            )
        if self.draw_free(box, room, state) is None:
            raise UserError(
                f"scenario {name}: {where} {self._shown(box)} has no point with {room:.2f} m of "
                "free room; move it away from obstacles or enlarge it"
            )

    def _no_pair(self, number: int) -> str:
        name, task = self.scenario.name, self.scenario.robot[number]
        ends = [set(np.unique(self.regions[self._window(box)])) for box in (task.start, task.goal)]
        if not (ends[0] & ends[1]) - {0}:
            return (
                f"scenario {name}: robot.{number} has no connected start and goal: no path leads "
                f"from {self._shown(task.start)} to {self._shown(task.goal)} for a robot of "
                f"radius {self.robot_radius:g} m; open a way or move a region"
            )
        nearest, farthest = self.scenario.start_goal_distance or _ANY_DISTANCE
        said = f"scenario {name}: robot.{number} has no connected start and goal that are"
        if nearest >= self.arrive_distance:
            return (
                f"{said} {span(nearest, farthest)} m apart; move its regions or widen "
                "start_goal_distance"
            )
        most, mend = "", ""
        if np.isfinite(farthest):
            most, mend = f" and at most {farthest:g} m", " or widen start_goal_distance"
        return (
            f"{said} at least {self.arrive_distance:g} m{most} apart; nearer ones have arrived "
            f"(task.arrive_distance); move its regions apart{mend}"
        )

    def _window(self, box: Box) -> tuple[slice, slice]:
        (bottom, left), (top, right) = self.grid.index(*box[:2]), self.grid.index(*box[2:])
        return slice(max(bottom, 0), top + 1), slice(max(left, 0), right + 1)

    def _shown(self, numbers: tuple[float, ...]) -> list[float]:
        """Coordinates x, y, x, y, ... as a person finds them in the map."""
        return [_round(v + self.map_origin[i % 2]) for i, v in enumerate(numbers)]


def _round(value: float) -> float:
    rounded = round(float(value), 3)
    return int(rounded) if rounded == int(rounded) else rounded


def _moved(scenario: Scenario, by: Point) -> Scenario:
    """Regions and routes moved by ``by`` (m): from a map's frame into its place's."""

    def box(b: Box) -> Box:
        return (b[0] + by[0], b[1] + by[1], b[2] + by[0], b[3] + by[1])

    def ends(what: Route | RobotTask) -> dict[str, Box]:
        return {"start": box(what.start), "goal": box(what.goal)}

    routes = [
        route.model_copy(
            update={**ends(route), "via": [(x + by[0], y + by[1]) for x, y in route.via]}
        )
        for route in scenario.pedestrians.routes
    ]
    tasks = [task.model_copy(update=ends(task)) for task in scenario.robot]
    people = scenario.pedestrians.model_copy(update={"routes": routes})
    inside = scenario.inside and (scenario.inside[0] + by[0], scenario.inside[1] + by[1])
    return scenario.model_copy(update={"pedestrians": people, "robot": tasks, "inside": inside})


def _furnished(
    scenario: Scenario,
    grid: OccupancyGrid,
    distance: NDArray[np.float32],
    regions: NDArray[np.int32],
    radius: float,
    origin: Point,
) -> tuple[Scenario, tuple[str, ...]]:
    """A map scenario with people and tasks where it names none, and what had to give way."""
    if scenario.inside is not None:
        chosen = floor_around(scenario, grid, regions, origin, radius)
        distance = np.where(regions == chosen, distance, np.float32(0.0))
    people, note = find_people(scenario.pedestrians, distance, grid.resolution)
    notes = [note] if note else []
    found = [] if scenario.pedestrians.routes else [centre(r.start) for r in people.routes]
    changes: dict[str, object] = {"pedestrians": people}
    if not scenario.robot:
        tasks, limits, note = find_tasks(
            distance, grid.resolution, radius, scenario.start_goal_distance, scenario.name
        )
        found += [centre(task.start) for task in tasks]
        changes |= {"robot": tasks, "start_goal_distance": limits}
        notes += [note] if note else []
    note = edge_note(scenario, grid, regions, radius, found)
    notes += [note] if note else []
    return scenario.model_copy(update=changes), tuple(notes)


def _with_ways(place: Place) -> Scenario:
    """The scenario, its routes led around walls where they name no waypoints and cross one."""
    scenario, grid = place.scenario, place.grid
    routes = list(scenario.pedestrians.routes)
    roadmap: Roadmap | None = None
    for i, route in enumerate(routes):
        start, goal = (np.array([b[0] + b[2], b[1] + b[3]]) / 2 for b in (route.start, route.goal))
        if route.via:
            continue
        if roadmap is None:
            roadmap = Roadmap.build(place.distance, grid.resolution, PEDESTRIAN_ROOM, COMFORT)
        if roadmap.sees(start, goal, 0.0):
            continue
        via = plan_via(roadmap, route.start, route.goal)
        if via is None:
            raise UserError(
                f"scenario {scenario.name}: pedestrians.routes.{i} has no path from "
                f"{place._shown(route.start)} to {place._shown(route.goal)}; open a way or move it"
            )
        routes[i] = route.model_copy(update={"via": via})
    people = scenario.pedestrians.model_copy(update={"routes": routes})
    return scenario.model_copy(update={"pedestrians": people})


@kernel()
def draw_free(distance, inverse_resolution, x_min, y_min, x_max, y_max, room, state, tries):
    """Uniform point of a box with ``room`` m to every wall; (nan, nan) after ``tries``."""
    for _ in range(tries):
        x = x_min + (x_max - x_min) * uniform(state)
        y = y_min + (y_max - y_min) * uniform(state)
        free = sample_field(distance, inverse_resolution, x, y) - 0.5 / inverse_resolution
        if free >= room:
            return x, y
    return np.nan, np.nan


def weighted_choice(weights: list[float], state: State) -> int:
    """Index drawn in proportion to ``weights``."""
    left = uniform(state) * sum(weights)
    for i, weight in enumerate(weights):
        left -= weight
        if left < 0.0:
            return i
    return len(weights) - 1
