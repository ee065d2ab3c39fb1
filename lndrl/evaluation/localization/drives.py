"""Recorded drives: what a robot sensed while somebody drove it, and where it truly was."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.config import WorldConfig
from lndrl.evaluation.localization.tour import RouteMap, Tour
from lndrl.randomness import State, Stream, stream_state, uniform
from lndrl.world import Place, World

Floats = NDArray[np.float64]

DRIVE_WORLD = 4_100_000_000
"""World id of the drives, in no family of episodes (``lndrl.navigation.families``)."""
DISPLACEMENT = 3.0  # m, how far a kidnapped robot is from where it thinks it is
_DIRECTIONS = 64


@dataclass(frozen=True, eq=False)
class SensorLog:
    """n ticks of one robot; poses are [x, y, yaw] (m, rad).

    ``truth`` and ``odometry`` ``(n, 3)`` in the map's and the odometer's frame (the latter from
    (0, 0, 0) at ``start``, the true pose before the first tick), ``ranges`` float32
    ``(n, beams)`` m of all beams, with noise. ``hits`` counts contacts: ticks in which the robot
    began to touch a wall or a pedestrian.
    """

    start: Floats
    truth: Floats
    odometry: Floats
    ranges: NDArray[np.float32]
    hits: dict[str, int]

    def first(self, ticks: int) -> SensorLog:
        """The first ``ticks`` of them; the contacts are those of all."""
        upto = slice(0, ticks)
        return SensorLog(
            self.start, self.truth[upto], self.odometry[upto], self.ranges[upto], self.hits
        )


@dataclass(frozen=True, eq=False)
class Drive(SensorLog):
    """The log of a tour through a place and what is needed to make trouble on it.

    ``tick`` (s); ``displaced`` (2,) is a free point ``DISPLACEMENT`` m from the truth at
    ``halfway``.
    """

    tick: float
    displaced: Floats
    goals_reached: int

    @property
    def halfway(self) -> int:
        """The tick after which a kidnapped robot finds itself elsewhere."""
        return len(self.truth) // 2

    @property
    def length(self) -> float:
        """Metres driven."""
        return float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum())


def record(
    world: World, command: Callable[[World], tuple[float, float]], updates: int, every: int
) -> SensorLog:
    """Drive ``world``, which has been reset, for ``updates`` ticks; contacts end nothing.

    ``command`` is asked for v (m/s) and w (rad/s) at every ``every``-th tick.
    """
    start = world.pose_true.copy()
    truth, odometry = np.zeros((updates, 3)), np.zeros((updates, 3))
    ranges = np.zeros((updates, world.config.laser.beams), dtype=np.float32)
    hits = {"wall": 0, "pedestrian": 0}
    touching = ""
    for i in range(updates):
        if i % every == 0:
            world.begin_step(*command(world))
        world.tick()
        if world.collided_with and world.collided_with != touching:
            hits[world.collided_with] += 1
        touching = world.collided_with
        truth[i] = world.pose_true
        odometry[i] = world.pose_odometry
        ranges[i] = world.scan()
    return SensorLog(start, truth, odometry, ranges, hits)


def record_drive(
    place: Place, routes: RouteMap, config: WorldConfig, seed: int, updates: int
) -> Drive:
    """Tour ``place`` for ``updates`` ticks; contacts are counted and end nothing.

    The same (place, config, seed, updates) give the same drive, bit for bit.
    """
    world = World(place, config)
    world.reset(seed, DRIVE_WORLD, 0)
    goals = stream_state(seed, DRIVE_WORLD, 0, Stream.POLICY)
    tour = Tour(place, routes, config.tick * config.ticks_per_step, goals)
    log = record(
        world,
        lambda world: tour.command(
            world.pose_true, world.pedestrian_position, world.pedestrian_velocity
        ),
        updates,
        config.ticks_per_step,
    )
    displaced = draw_displaced(place, log.truth[updates // 2], goals)
    return Drive(
        **vars(log), tick=config.tick, displaced=displaced, goals_reached=tour.goals_reached
    )


def draw_displaced(place: Place, pose: Floats, state: State) -> Floats:
    """A point (2,) ``DISPLACEMENT`` m from ``pose`` in a random direction, where there is room.

    Where no direction has room for the robot, the roomiest of those tried.
    """
    best, most = np.zeros(2), -1.0
    for _ in range(_DIRECTIONS):
        angle = 2.0 * math.pi * uniform(state)
        point = pose[:2] + DISPLACEMENT * np.array([math.cos(angle), math.sin(angle)])
        room = place.room(float(point[0]), float(point[1]))
        if room >= place.robot_radius:
            return point
        if room > most:
            best, most = point, room
    return best
