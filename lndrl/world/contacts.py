"""Does the robot touch a wall or a leg? pymunk decides; a cheap test spares it most ticks.

The walls are the scenario's exact geometry, not its cells. Only the two legs of a pedestrian are
solid, as in the group's simulator (parameters §4.1).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import pymunk
import pymunk.batch
from numba import njit
from numpy.typing import NDArray

from lndrl.maps.embedded import unpack
from lndrl.maps.outlines import grid_outlines, segments
from lndrl.scenario import Obstacle, Scenario

Hit = Literal["", "wall", "pedestrian"]

_WALL, _LEG = 1, 2
_ASIDE = 1e6  # m; where legs of absent pedestrians wait
_SLACK = 3.0  # cells; geometry and cells differ by less


class Contacts:
    """A pymunk space with the walls of one scenario and up to ``legs`` leg discs."""

    def __init__(
        self, scenario: Scenario, robot_radius: float, leg_radius: float, legs: int
    ) -> None:
        self.robot_radius = robot_radius
        self.leg_radius = leg_radius
        self._space = pymunk.Space()
        for shape in _wall_shapes(scenario, self._space.static_body):
            shape.collision_type = _WALL
            self._space.add(shape)
        self._legs = np.full((legs, 2), _ASIDE)
        for _ in range(legs):
            body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
            disc = pymunk.Circle(body, leg_radius)
            disc.collision_type = _LEG
            disc.filter = pymunk.ShapeFilter(group=1)  # legs ignore each other
            self._space.add(body, disc)
        self._buffer = pymunk.batch.Buffer()
        self._buffer.set_float_buf(self._legs)
        self._filter = pymunk.ShapeFilter()

    def hit(
        self,
        pose: NDArray[np.float64],
        legs: NDArray[np.float64],
        distance: NDArray[np.float32],
        resolution: float,
    ) -> Hit:
        """What the robot's disc at ``pose`` touches: "", "wall" or "pedestrian".

        ``legs`` is ``(L, 2)`` (m), ``distance`` the map's field with cells of ``resolution`` m.
        Where it touches both, the one it overlaps more.
        """
        if not may_touch(
            pose, legs, distance, 1.0 / resolution, self.robot_radius, self.leg_radius
        ):
            return ""
        self._legs[: len(legs)] = legs
        self._legs[len(legs) :] = _ASIDE
        if len(self._legs):
            pymunk.batch.set_space_bodies(
                self._space, pymunk.batch.BodyFields.POSITION, self._buffer
            )
            self._space.step(1e-9)  # nothing moves: refreshes the spatial index
        info = self._space.point_query_nearest(
            (float(pose[0]), float(pose[1])), self.robot_radius, self._filter
        )
        if info is None or info.shape is None:
            return ""
        return "wall" if info.shape.collision_type == _WALL else "pedestrian"


@njit(cache=True, nogil=True)
def may_touch(pose, legs, distance, inverse_resolution, robot_radius, leg_radius):
    """False when the robot certainly touches nothing."""
    rows, columns = distance.shape
    column = int(np.floor(pose[0] * inverse_resolution))
    row = int(np.floor(pose[1] * inverse_resolution))
    if row < 0 or column < 0 or row >= rows or column >= columns:
        return True
    if distance[row, column] <= robot_radius + _SLACK / inverse_resolution:
        return True
    reach2 = (robot_radius + leg_radius + 1e-6) ** 2
    for i in range(len(legs)):
        if (legs[i, 0] - pose[0]) ** 2 + (legs[i, 1] - pose[1]) ** 2 <= reach2:
            return True
    return False


def _wall_shapes(scenario: Scenario, body: pymunk.Body) -> list[pymunk.Shape]:
    width, height = scenario.size
    shapes: list[pymunk.Shape] = []
    if scenario.kind == "map":
        edges = segments(grid_outlines(unpack(scenario))).tolist()
        return [pymunk.Segment(body, (a, b), (c, d), 0.0) for a, b, c, d in edges]
    if scenario.wall > 0:
        t = scenario.wall
        # A metre thicker to the outside, so that nobody ends up behind them.
        shapes += [
            _box(body, -1.0, -1.0, t, height + 1.0),
            _box(body, width - t, -1.0, width + 1.0, height + 1.0),
            _box(body, -1.0, -1.0, width + 1.0, t),
            _box(body, -1.0, height - t, width + 1.0, height + 1.0),
        ]
    for obstacle in scenario.obstacles:
        shapes += _obstacle_shapes(obstacle, body)
    return shapes


def _obstacle_shapes(obstacle: Obstacle, body: pymunk.Body) -> list[pymunk.Shape]:
    if obstacle.box is not None:
        return [_box(body, *obstacle.box)]
    if obstacle.circle is not None:
        x, y, radius = obstacle.circle
        return [pymunk.Circle(body, radius, (x, y))]
    corners = obstacle.polygon or []
    # Edges, not a solid: pymunk's polygons are convex, and no tick jumps over a robot's radius.
    return [
        pymunk.Segment(body, a, b, 0.0)
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]


def _box(body: pymunk.Body, x0: float, y0: float, x1: float, y1: float) -> pymunk.Poly:
    return pymunk.Poly(body, [(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
