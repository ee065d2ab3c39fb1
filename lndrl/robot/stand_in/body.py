"""A world as a robot senses it: what its drivers would publish after each tick, as plain data."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.localization import AMCL, LikelihoodMap, Scanner, interpolate
from lndrl.navigation.families import Family
from lndrl.navigation.navigation import layout_of
from lndrl.randomness import Stream, episode_states
from lndrl.robot import geometry
from lndrl.robot.messages import (
    SECOND,
    Content,
    GridMap,
    Odometry,
    People,
    Poses,
    Scan,
    StampedPose,
    Transform,
    Transforms,
)
from lndrl.world import Place, World
from lndrl.world.laser import add_noise, trace

Floats = NDArray[np.float64]

MAP, ODOM, BASE, LASER = "map", "odom", "base_link", "base_scan"
"""Frames, by REP 105."""
_SECTORS = 16
"""Of a scan that takes its time: beams of one are cast from one place, 6 ms apart."""
RANGE_MIN = 0.05
"""m, of a scanner that has none: less than the robot's own radius."""


class Body:
    """The robot of test episodes of ``config``, which ``lndrl evaluate`` would drive in.

    ``scanner``: how it stands, and below which range it is blind; it sees as far as the laser of
    ``config``. ``localizes``: it has an AMCL of its own. ``fastest`` (m/s, rad/s): commands beyond
    are cut; None: none is. ``sweeps``: its scanner takes the whole of a tick to turn round, as one
    of 10 Hz does, and a scan is stamped with its first beam. Between episodes the robot is
    carried to the next start, of which its odometry notices nothing. Call ``begin`` first. Raises
    UserError for an impossible scenario.
    """

    def __init__(
        self,
        config: RunConfig,
        scanner: Scanner | None = None,
        localizes: bool = False,
        fastest: tuple[float, float] | None = None,
        sweeps: bool = False,
    ) -> None:
        self.config = config
        laser = config.world.laser
        self.scanner = replace(scanner or Scanner(), range_max=float(laser.range_max))
        self._fastest = fastest or (np.inf, np.inf)
        self._localizes, self._sweeps = localizes, sweeps
        self._layout = -1
        self._odometry = np.zeros(3)  # where the odometer's zero of this episode is
        self._move_to(0)

    @property
    def steps_limit(self) -> int:
        """Control steps after which an episode of ``lndrl evaluate`` is out of time."""
        return self.config.steps_limit

    @property
    def pose_true(self) -> Floats:
        """(3,) in the map frame."""
        return self.world.pose_true + self._shift

    @property
    def start(self) -> Floats:
        """(3,) of the episode, in the map frame."""
        return self.world.start_pose + self._shift

    @property
    def goal(self) -> Floats:
        """(2,) of the episode, in the map frame."""
        return self.world.goal + self._shift[:2]

    def begin(self, episode: int) -> bool:
        """Begin the ``episode``-th; says whether the map is another one now."""
        seed, number = self.config.seed, Family.VALIDATION.world(episode)
        if self._layout >= 0:
            self._odometry = geometry.chained(self._odometry, self.world.pose_odometry)
        layout = layout_of(self.config, number, 0, seed)
        moved = layout != self._layout
        if moved:
            self._move_to(layout)
        states = episode_states(seed, number, 0)
        self.world.reset(seed, number, 0, states)
        self._before = self.world.pose_true.copy()  # a tick ago
        self._ticks = 0
        if self._filter is not None:
            self._filter.reset(self.world.start_pose, states[Stream.LOCALIZATION])
        return moved

    def tick(self, v: float, w: float) -> bool:
        """A tick with the command ``v`` (m/s), ``w`` (rad/s); says whether something is touched.

        Velocities follow it as fast as ``world.robot.acceleration`` lets them. Wheels slip anew in
        every control step, as in training.
        """
        v, w = np.clip((v, w), np.negative(self._fastest), self._fastest).tolist()
        if self._ticks % self.config.world.ticks_per_step == 0:
            self.world.begin_step(v, w)
        self.world.command[:] = v, w
        self._ticks += 1
        self._before[:] = self.world.pose_true
        return self.world.tick()

    @property
    def between_steps(self) -> bool:
        """Whether a control step of training would end here."""
        return self._ticks % self.config.world.ticks_per_step == 0

    @property
    def steps(self) -> int:
        """Control steps since the start."""
        return self._ticks // int(self.config.world.ticks_per_step)

    def map(self, stamp: int) -> GridMap:
        """The map, as a map server publishes it."""
        grid = self.place.grid
        cells = np.where(grid.occupied, np.int8(100), np.int8(0))
        if grid.unknown is not None:
            cells[grid.unknown] = -1
        return GridMap(stamp, MAP, grid.resolution, self._shift.copy(), cells)

    def mounting(self, stamp: int) -> Transforms:
        """Where the scanner is on the base."""
        at = np.array([self.scanner.x, self.scanner.y, 0.2])
        flipped = np.diag([1.0, -1.0, -1.0]) if self.scanner.upside_down else np.eye(3)
        turned = geometry.rotation(self.scanner.yaw) @ flipped
        return Transforms((Transform(stamp, BASE, LASER, at, turned),))

    def odometry(self, stamp: int) -> Odometry:
        """What the wheels say."""
        return Odometry(stamp, ODOM, BASE, self._pose_odometry(), self.world.robot.velocity.copy())

    def transforms(self, stamp: int) -> Transforms:
        """odom to base, and map to odom where the robot localizes itself."""
        found = [_transform(stamp, ODOM, BASE, self._pose_odometry())]
        if self._filter is not None:
            estimate = self._filter.pose_estimated + self._shift
            here = geometry.chained(estimate, geometry.inverse(self._pose_odometry()))
            found.append(_transform(stamp, MAP, ODOM, here))
        return Transforms(tuple(found))

    def people(self, stamp: int) -> People:
        """Everybody, as a perfect tracker sees them: in the frame of the odometry."""
        frame = geometry.chained(
            self._pose_odometry(), geometry.inverse(self.world.pose_true)
        )  # of the place, seen from the odometry's
        position = geometry.moved_points(frame, self.world.pedestrian_position)
        velocity = geometry.turned_vectors(frame, self.world.pedestrian_velocity)
        ids = np.arange(len(position), dtype=np.int64)
        return People(stamp, ODOM, ids, position, velocity)

    def people_poses(self, stamp: int) -> Poses:
        """The same without names and velocities."""
        position = self.people(stamp).position
        return Poses(stamp, ODOM, np.column_stack([position, np.zeros(len(position))]))

    def scan(self, stamp: int) -> Scan:
        """A turn of the laser from where it is mounted, no echo as infinity (REP 117).

        A robot that localizes itself takes it in.
        """
        laser, world, scanner = self.config.world.laser, self.world, self.scanner
        ranges = self._ranges()
        if self._filter is not None:
            self._filter.update(world.pose_odometry, ranges, self._bearings)
        shown = np.where(ranges >= laser.range_max, np.float32(np.inf), ranges)
        shown[ranges <= scanner.range_min] = 0.0  # as drivers write what is too near
        first, increment = -0.5 * laser.field_of_view, laser.field_of_view / laser.beams
        if scanner.upside_down:
            shown, first = shown[::-1].copy(), -(first + increment * (laser.beams - 1))
        nearest = max(scanner.range_min, RANGE_MIN)
        tick = float(self.config.world.tick)
        scan = Scan(
            stamp, LASER, first, increment, nearest, laser.range_max, shown, scan_time=tick
        )  # fmt: skip
        if not self._sweeps:
            return scan
        began = stamp - round(tick * SECOND)
        return replace(scan, stamp=began, time_increment=tick / laser.beams)

    def _ranges(self) -> NDArray[np.float32]:
        """What the laser reads (beams,), in the order in which the world casts it."""
        laser, world = self.config.world.laser, self.world
        setting, scratch = world.batch.setting, world.batch.scratch.laser
        mount = np.array([self.scanner.x, self.scanner.y, self.scanner.yaw])
        ranges, true = np.empty((2, laser.beams), np.float32)
        sectors = np.array_split(np.arange(laser.beams), _SECTORS if self._sweeps else 1)
        for number, sector in enumerate(reversed(sectors) if self.scanner.upside_down else sectors):
            passed = (number + 1) / len(sectors)
            base = world.pose_true
            if passed < 1.0:
                base = interpolate(self._before, world.pose_true, passed)
            trace(
                setting.rays, setting.fan, geometry.chained(base, mount), world.leg_position,
                setting.leg_radius, 1, scratch, ranges,
            )  # fmt: skip
            true[sector] = ranges[sector]
        add_noise(true, setting.fan, world.robot.laser_random, scratch.normals, ranges)
        return ranges

    def own_pose(self, stamp: int) -> StampedPose | None:
        """What the robot's own AMCL says, where it has one."""
        if self._filter is None:
            return None
        pose = self._filter.pose_estimated + self._shift
        return StampedPose(stamp, MAP, pose, self._filter.covariance.copy())

    def initial_pose(self, stamp: int) -> StampedPose:
        """What a user would click in RViz: the start, to within what episodes begin with."""
        spread = np.array(self.config.localization.initial_deviations)
        return StampedPose(stamp, MAP, self.start, np.diag(spread * spread))

    def goal_pose(self, stamp: int) -> StampedPose:
        """The goal, looking where the start looks, as in training."""
        return StampedPose(stamp, MAP, np.array([*self.goal, self.start[2]]))

    def _pose_odometry(self) -> Floats:
        return geometry.chained(self._odometry, self.world.pose_odometry)

    def _move_to(self, layout: int) -> None:
        config, laser = self.config, self.config.world.laser
        self.place = Place.build(
            config.scenario, config.world.robot_radius, layout, config.task.arrive_distance
        )
        self.world = World(self.place, config.world)
        self._shift = np.array([*self.place.map_origin, 0.0])
        self._layout = layout
        self._filter: AMCL | None = None
        increment = laser.field_of_view / laser.beams
        # In the order in which the world casts them, whichever way the scanner counts.
        upright = replace(self.scanner, upside_down=False)
        self._bearings = upright.bearings(-0.5 * laser.field_of_view, increment, laser.beams)
        if self._localizes:
            field = LikelihoodMap.build(self.place.grid, config.localization, laser)
            self._filter = AMCL(field, config.localization, laser, scanner=self.scanner)


def _transform(stamp: int, parent: str, child: str, pose: Floats) -> Transform:
    at = np.array([pose[0], pose[1], 0.0])
    return Transform(stamp, parent, child, at, geometry.rotation(float(pose[2])))


def shifted(content: Content, by: int) -> Content:
    """``content`` with its stamps ``by`` ns later."""
    if isinstance(content, Transforms):
        moved = tuple(replace(each, stamp=each.stamp + by) for each in content.transforms)
        return Transforms(moved)
    stamped: Any = content
    return replace(stamped, stamp=stamped.stamp + by) if hasattr(content, "stamp") else content
