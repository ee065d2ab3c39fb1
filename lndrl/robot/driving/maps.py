"""The robot's map: what can be localized on, and which goals lie on free floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from lndrl.config import RunConfig
from lndrl.maps.edges import ray_map
from lndrl.maps.grid import OccupancyGrid, distance_field
from lndrl.maps.outlines import grid_outlines, segments
from lndrl.maps.raycast import clearance
from lndrl.maps.ros_map import FREE, OCCUPIED, UNKNOWN, along_the_axes, grid_of_cells
from lndrl.robot.driving.reasons import Reason
from lndrl.robot.messages import GridMap
from lndrl.world import Place

Floats = NDArray[np.float64]

OCCUPIED_FROM = 65
"""Percent from which a cell is solid, as nav2's AMCL and map server have it."""
FREE_BELOW = 25
_LARGEST = 2**26


class MapFaultError(Exception):
    """A map that nothing can drive on: a reason and what was seen."""

    def __init__(self, reason: Reason, words: str) -> None:
        super().__init__(words)
        self.reason, self.words = reason, words


@dataclass(frozen=True, eq=False)
class RobotMap:
    """A map in use. ``room`` float32 (rows, columns): m to the nearest solid cell; ``areas`` number
    the connected floor that the robot's centre can be on, 0 where it does not fit.
    """

    frame: str
    grid: OccupancyGrid
    room: NDArray[np.float32]
    areas: NDArray[np.int32]
    robot_radius: float

    @classmethod
    def of_message(cls, message: GridMap, robot_radius: float) -> RobotMap:
        """Of what a map server publishes; raises MapFaultError."""
        cells = message.cells
        if cells.ndim != 2:
            raise MapFaultError(
                Reason.MAP_INVALID, f"the map has {cells.size} cells, not as many as it says"
            )
        if not (np.isfinite(message.origin).all() and 1e-4 < message.resolution < 10.0):
            raise MapFaultError(
                Reason.MAP_INVALID,
                f"the map has a resolution of {message.resolution:g} m, or an origin that is not "
                "finite",
            )
        if not 0 < cells.size <= _LARGEST:
            raise MapFaultError(Reason.MAP_INVALID, f"the map has {cells.size:,} cells")
        known = np.full(cells.shape, UNKNOWN, np.uint8)
        known[(cells >= 0) & (cells < FREE_BELOW)] = FREE
        known[cells >= OCCUPIED_FROM] = OCCUPIED
        if not (known == FREE).any():
            raise MapFaultError(Reason.MAP_INVALID, "the map has no free cell")
        x, y, yaw = (float(each) for each in message.origin)
        known, origin = along_the_axes(known, message.resolution, (x, y, yaw))
        grid = grid_of_cells(known, message.resolution, origin)
        return cls.of_grid(message.frame or "map", grid, robot_radius)

    @classmethod
    def of_grid(cls, frame: str, grid: OccupancyGrid, robot_radius: float) -> RobotMap:
        """Of a grid in the frame ``frame``."""
        room = distance_field(grid.occupied, grid.resolution)
        areas, _ = label(room > robot_radius)
        return cls(frame, grid, room, areas, robot_radius)

    def same_as(self, other: RobotMap | None) -> bool:
        """Whether ``other`` is the same map, sent once more."""
        if other is None or other.frame != self.frame:
            return False
        mine, theirs = self.grid, other.grid
        return (
            mine.origin == theirs.origin
            and mine.resolution == theirs.resolution
            and np.array_equal(mine.occupied, theirs.occupied)
        )

    def fault_of_goal(self, goal: Floats, pose: Floats | None) -> tuple[Reason, str] | None:
        """Why the robot, at ``pose`` where that is known, cannot get to ``goal`` (2,)."""
        said = f"the goal ({goal[0]:.2f}, {goal[1]:.2f})"
        if not np.isfinite(goal).all() or not self.grid.contains(*goal):
            return Reason.GOAL_OFF_MAP, f"{said} is not on the map"
        here = self.grid.index(*goal)
        if self.areas[here] == 0:
            room = float(self.room[here])
            return Reason.GOAL_IN_WALL, f"{said} has {room:.2f} m of room"
        if pose is not None and self.area_near(pose) not in (0, self.areas[here]):
            return Reason.GOAL_UNREACHABLE, f"no floor leads from the robot to {said[4:]}"
        return None

    def area_near(self, pose: Floats) -> int:
        """The area at ``pose``, or next to it: estimates are a little off; 0: there is none."""
        row, column = self.grid.index(*pose[:2])
        reach = max(1, round(0.5 / self.grid.resolution))
        part = self.areas[
            max(row - reach, 0) : max(row + reach + 1, 0),
            max(column - reach, 0) : max(column + reach + 1, 0),
        ]
        there = part[part > 0]
        return int(np.bincount(there).argmax()) if there.size else 0

    def place(self, config: RunConfig) -> Place:
        """What planners that know the map are told; in the place's own frame, see ``Place``."""
        grid = OccupancyGrid(self.grid.occupied, self.grid.resolution, (0.0, 0.0),
                             self.grid.unknown, self.grid.edge)  # fmt: skip
        outlines = grid_outlines(grid)
        cells = clearance(self.room, grid.resolution)
        return Place(
            config.scenario, grid, self.room, cells, ray_map(grid, cells), segments(outlines),
            (self.areas % 2**16).astype(np.uint16), self.robot_radius,
            config.task.arrive_distance, outlines, self.grid.origin,
        )  # fmt: skip
