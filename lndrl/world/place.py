"""A place: a scenario with everything that is computed from it once per process."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import label

from lndrl.config import WorldConfig
from lndrl.errors import UserError
from lndrl.maps.edges import RayMap, ray_map
from lndrl.maps.grid import OccupancyGrid, distance_field, grid_from_scenario
from lndrl.maps.raycast import clearance, sample_field
from lndrl.randomness import State, stream_state, uniform
from lndrl.scenario import Box, RobotTask, Scenario

ROBOT_MARGIN = 0.1  # m of free room around the robot at its start and goal
PEDESTRIAN_ROOM = 0.3  # m of free room around a pedestrian's start and goal
_TRIES = 2000
_CIRCLE_SEGMENTS = 24

Start = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Place:
    """A validated scenario with its grid, distance field and wall outlines.

    ``distance`` float32 ``(h, w)`` (m, centre to centre), ``cells`` the same in whole cells
    (uint8), ``rays`` what the laser's kernels need; ``walls`` ``(S, 4)`` segments
    [x0, y0, x1, y1] (m), circles as 24-gons; ``regions`` int32 ``(h, w)`` numbers the connected
    areas that the robot's centre can move in, 0 where it does not fit.
    """

    scenario: Scenario
    grid: OccupancyGrid
    distance: NDArray[np.float32]
    cells: NDArray[np.uint8]
    rays: RayMap
    walls: NDArray[np.float64]
    regions: NDArray[np.int32]
    robot_radius: float

    @classmethod
    def build(cls, scenario: Scenario, robot_radius: float | None = None) -> Place:
        """Rasterise and validate ``scenario`` for a robot of ``robot_radius`` m (default: the
        configuration's).

        Raises UserError (scenario, region, mend) when a region leaves the map or has no free
        room, or when a robot task has no connected start and goal at ``start_goal_distance``.
        """
        radius = WorldConfig().robot_radius if robot_radius is None else robot_radius
        grid = grid_from_scenario(scenario)
        distance = distance_field(grid.occupied, grid.resolution)
        regions, _ = label(distance > radius + 0.5 * grid.resolution)
        cells = clearance(distance, grid.resolution)
        rays = ray_map(grid, cells)
        walls = wall_segments(scenario)
        place = cls(scenario, grid, distance, cells, rays, walls, regions, radius)
        place._check()
        return place

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
        """Start and goal (m) of an episode: connected, free, at ``start_goal_distance``.

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
        nearest, farthest = self.scenario.start_goal_distance
        for _ in range(_TRIES):
            start = self.draw_free(task.start, room, state)
            goal = self.draw_free(task.goal, room, state)
            if start is None or goal is None:
                return None
            distance = float(np.hypot(goal[0] - start[0], goal[1] - start[1]))
            if nearest <= distance <= farthest and self._connected(start, goal):
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
                        f"scenario {self.scenario.name}: {where}.via {list(point)} lies in a "
                        "wall or off the map; move it to free floor"
                    )

    def _check_region(self, where: str, box: Box, room: float, state: State) -> None:
        name = self.scenario.name
        width, height = self.scenario.size
        x_min, y_min, x_max, y_max = box
        if not (x_min <= x_max and y_min <= y_max):
            raise UserError(
                f"scenario {name}: {where} {list(box)} must be [x_min, y_min, x_max, y_max]"
            )
        if x_min < 0 or y_min < 0 or x_max > width or y_max > height:
            raise UserError(
                f"scenario {name}: {where} {list(box)} leaves the map; "
                f"it must lie in [0, 0, {width:g}, {height:g}]"
            )
        if self.draw_free(box, room, state) is None:
            raise UserError(
                f"scenario {name}: {where} {list(box)} has no point with {room:.2f} m of free "
                "room; move it away from obstacles or enlarge it"
            )

    def _no_pair(self, task: int) -> str:
        nearest, farthest = self.scenario.start_goal_distance
        return (
            f"scenario {self.scenario.name}: robot.{task} has no connected start and goal that "
            f"are {nearest:g} to {farthest:g} m apart; move its regions or widen "
            "start_goal_distance"
        )


@njit(cache=True, nogil=True)
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


def wall_segments(scenario: Scenario) -> NDArray[np.float64]:
    """Outlines of outer walls (inner faces) and obstacles, ``(S, 4)`` [x0, y0, x1, y1] (m)."""
    width, height = scenario.size
    t = scenario.wall
    outlines: list[list[Start]] = []
    if t > 0:
        outlines.append([(t, t), (width - t, t), (width - t, height - t), (t, height - t)])
    for obstacle in scenario.obstacles:
        if obstacle.box is not None:
            x0, y0, x1, y1 = obstacle.box
            outlines.append([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
        elif obstacle.circle is not None:
            x, y, r = obstacle.circle
            angles = np.linspace(0.0, 2.0 * np.pi, _CIRCLE_SEGMENTS, endpoint=False)
            outlines.append([(float(x + r * np.cos(a)), float(y + r * np.sin(a))) for a in angles])
        else:
            outlines.append(list(obstacle.polygon or []))
    segments = [(*a, *b) for o in outlines for a, b in pairwise([*o, o[0]])]
    return np.array(segments, dtype=np.float64).reshape(-1, 4)
