"""The truth of one world: robot, crowd, laser, odometer, contacts."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.config import WorldConfig
from lndrl.kernels import kernel
from lndrl.maps.edges import RayMap
from lndrl.randomness import State, Stream, episode_states, uniform
from lndrl.world import people as crowd_arrays
from lndrl.world.contacts import HITS, Hit, contact
from lndrl.world.laser import Fan, ScanScratch, make_fan, make_scan_scratch, noisy_scan
from lndrl.world.odometry import accelerate, draw_slip, move_robot
from lndrl.world.orca_walls import Walls, build_walls
from lndrl.world.pedestrians import advance_people, place_legs, wall_reach
from lndrl.world.people import CrowdParameters, People, Surroundings, make_people
from lndrl.world.place import Place
from lndrl.world.placement import Routes, make_routes, place_people
from lndrl.world.robot import Robot, make_robots, robot_of, take_command

Floats = NDArray[np.float64]


class Setting(NamedTuple):
    """What kernels need to know of a place and of how things move in it; never changed."""

    surroundings: Surroundings
    solid: Walls  # outlines that the robot can touch
    crowd: CrowdParameters
    rays: RayMap
    fan: Fan
    tick: float  # s
    odometry_per_reading: bool  # slip is drawn in every tick, not once per control step
    robot_radius: float  # m
    leg_radius: float  # m
    acceleration: tuple[float, float, float]  # see ``odometry.accelerate``; infinite: no limits

    def __deepcopy__(self, memo: dict[int, Any]) -> Setting:
        return self  # never changed, and megabytes


class Scratch(NamedTuple):
    """Working memory within one tick; one for all worlds of a thread."""

    crowd: crowd_arrays.Scratch
    laser: ScanScratch


@njit(inline="always")
def tick_inline(robot, people, setting, scratch):
    """One tick: people move, then the robot; ``robot.contact`` says what it touches then."""
    accelerate(robot.velocity, robot.command, setting.acceleration, setting.tick)
    advance_people(
        people, robot.pose, robot.velocity, setting.surroundings, setting.crowd, scratch.crowd
    )
    if setting.odometry_per_reading:
        draw_slip(robot.slip, robot.deviation[0], robot.odometry_random)
    move_robot(robot.pose, robot.odometry, robot.velocity, robot.slip, setting.tick)
    robot.clock[0] += setting.tick
    robot.contact[0] = contact(
        robot.pose,
        people.legs[: 2 * people.count[0]],
        setting.solid,
        setting.surroundings.distance,
        setting.surroundings.inverse_resolution,
        setting.robot_radius,
        setting.leg_radius,
    )


@kernel()
def tick_world(robot, people, setting, scratch):
    """``tick_inline`` for callers in Python."""
    tick_inline(robot, people, setting, scratch)


class WorldBatch:
    """Memory of ``worlds`` worlds in one place, and what they share.

    ``robots`` and ``people`` have a leading world dimension; ``setting``, ``routes`` and
    ``scratch`` serve all of them, as long as one thread runs them.
    """

    def __init__(self, place: Place, config: WorldConfig, worlds: int = 1) -> None:
        pedestrians = place.scenario.pedestrians
        waypoints = 2 + max((len(route.via) for route in pedestrians.routes), default=0)
        capacity = pedestrians.count[1]
        knows = config.crowd.orca_walls
        walls = place.solid(wall_reach(config.crowd)) if knows else build_walls((), 0.0)
        self.place = place
        self.config = config
        self.robots = make_robots(worlds, float(config.odometry_deviation))
        self.people = make_people(worlds, capacity, waypoints)
        self.routes: Routes = make_routes(pedestrians)
        self.setting = Setting(
            surroundings=Surroundings(place.distance, 1.0 / place.grid.resolution, walls),
            solid=place.solid(float(config.robot_radius)),
            crowd=CrowdParameters.of(config.crowd, config.tick),
            rays=place.rays,
            fan=make_fan(config.laser),
            tick=float(config.tick),
            odometry_per_reading=config.odometry_draw == "reading",
            robot_radius=float(config.robot_radius),
            leg_radius=float(config.crowd.leg_radius),
            acceleration=config.robot.acceleration.limits,
        )
        self.scratch = Scratch(
            crowd_arrays.make_scratch(capacity, config.crowd, walls),
            make_scan_scratch(config.laser.beams),
        )


class World:
    """One simulated world; knows nothing of beliefs and policies.

    Map frame, metres, radians, seconds; arrays are float64 and updated in place. ``pose_true``
    and ``start_pose`` [x, y, yaw], ``goal`` [x, y], ``command`` [v, w], ``pose_odometry``
    [x, y, yaw] with slip from (0, 0, 0) at the start. ``pedestrian_position``,
    ``pedestrian_velocity`` ``(P, 2)`` and ``leg_position`` ``(2P, 2)`` are views of this
    episode's P pedestrians. Call ``reset`` before anything else. A copy has memory of its own.

    ``batch`` is the memory to live in, as its world number ``index``; by default an own one.
    """

    def __init__(
        self, place: Place, config: WorldConfig, batch: WorldBatch | None = None, index: int = 0
    ) -> None:
        self.batch = WorldBatch(place, config) if batch is None else batch
        self.index = index
        self.place = place
        self.config = config
        self.robot: Robot = robot_of(self.batch.robots, index)
        self.people: People = self.batch.people.world(index)
        self.pose_true = self.robot.pose
        self.pose_odometry = self.robot.odometry
        self.start_pose = self.robot.start
        self.goal = self.robot.goal
        self.command = self.robot.command

    def __reduce__(self) -> tuple[Any, ...]:
        # All that is here are views of the batch's arrays, which a copy would part from them.
        return type(self), (self.place, self.config, self.batch, self.index)

    @property
    def time(self) -> float:
        """Seconds since the start of the episode."""
        return float(self.robot.clock[0])

    @property
    def collided_with(self) -> Hit:
        """What the robot touched after the last tick, "" for nothing."""
        return HITS[self.robot.contact[0]]

    @property
    def pedestrian_count(self) -> int:
        """People in this episode."""
        return int(self.people.count[0])

    @property
    def pedestrian_position(self) -> Floats:
        """View ``(P, 2)`` (m)."""
        return self.people.position[: self.people.count[0]]

    @property
    def pedestrian_velocity(self) -> Floats:
        """View ``(P, 2)`` (m/s)."""
        return self.people.velocity[: self.people.count[0]]

    @property
    def leg_position(self) -> Floats:
        """View ``(2P, 2)`` (m)."""
        return self.people.legs[: 2 * self.people.count[0]]

    def reset(self, seed: int, world_id: int, episode: int, states: State | None = None) -> None:
        """Start the episode that (seed, world_id, episode) stand for, bit for bit the same.

        ``states`` are that episode's ``episode_states`` where the caller has them. Raises
        UserError when the scenario offers no start and goal (see ``Place.draw_task``).
        """
        if states is None:
            states = episode_states(seed, world_id, episode)
        layout = states[Stream.LAYOUT]
        start, goal = self.place.draw_task(layout)
        self.start_pose[:] = (*start, np.pi * (2.0 * uniform(layout) - 1.0))
        self.goal[:] = goal
        self.robot.laser_random[:] = states[Stream.LASER]
        self.robot.odometry_random[:] = states[Stream.ODOMETRY]
        self.pose_true[:] = self.start_pose
        self.pose_odometry[:] = 0.0
        self.command[:] = 0.0
        self.robot.velocity[:] = 0.0
        self.robot.slip[:] = 1.0
        self.robot.clock[:] = 0.0
        self.robot.contact[:] = 0
        batch = self.batch
        people, crowd, around = self.people, batch.setting.crowd, batch.setting.surroundings
        place_people(
            people, batch.routes, around.distance, around.inverse_resolution, self.start_pose,
            crowd.max_speed, 8.0 * crowd.step_length, states[Stream.PEDESTRIANS],
        )  # fmt: skip
        place_legs(
            people.count[0], people.position, people.heading, people.travelled,
            crowd.step_length, crowd.leg_offset, people.legs,
        )  # fmt: skip

    def begin_step(self, v: float, w: float) -> None:
        """Set the command of the coming ticks (m/s, rad/s); draws the odometer's slip."""
        take_command(self.robot, v, w)

    def tick(self) -> bool:
        """``config.tick`` seconds pass: people move, then the robot; True when it now touches
        something (``collided_with`` says what).
        """
        tick_world(self.robot, self.people, self.batch.setting, self.batch.scratch)
        return bool(self.robot.contact[0] != 0)

    def scan(self) -> NDArray[np.float32]:
        """Ranges of all beams with noise (m, in [0, range_max]), a new ``(beams,)`` array."""
        return self.scan_sparse(1)

    def scan_sparse(self, stride: int) -> NDArray[np.float32]:
        """Ranges of beams 0, stride, 2 * stride, ... with noise (m), a new array."""
        out = np.empty(-(-self.config.laser.beams // stride), dtype=np.float32)
        setting = self.batch.setting
        noisy_scan(
            setting.rays, setting.fan, self.robot.pose, self.leg_position, setting.leg_radius,
            stride, self.robot.laser_random, self.batch.scratch.laser, out,
        )  # fmt: skip
        return out
