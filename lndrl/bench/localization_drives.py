"""How well a localization tracks: recorded drives, replayed through any ``LocalizationConfig``.

Sensor logs are made once by the true world; every configuration then hears the same logs, so two
figures differ by the filter and nothing else. Knows the filter only through ``AMCL``'s interface.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from lndrl.config import LaserConfig, LocalizationConfig, WorldConfig
from lndrl.localization import AMCL, LikelihoodMap, amcl_beam_stride
from lndrl.maps.grid import OccupancyGrid
from lndrl.randomness import Stream, stream_state
from lndrl.scenario import Obstacle, Pedestrians, RobotTask, Scenario
from lndrl.world import Place, World, beam_bearings

LOST = 0.5
"""m: a drive with a larger position RMSE counts as lost."""
_TURNS = np.linspace(-1.0, 1.0, 9)
"""rad/s that the driver may choose between."""
_LOOK_AHEAD = np.arange(0.3, 2.1, 0.3)
"""s"""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Drive:
    """One log: ``truth`` and ``odometry`` (T, 3) [x, y, yaw] (m, rad), ``ranges`` float32
    (T, beams) of ALL beams (m), ``start`` (3,) the true pose before the first entry.
    """

    start: Floats
    truth: Floats
    odometry: Floats
    ranges: NDArray[np.float32]


@dataclass(frozen=True)
class Outcome:
    """Errors of every drive with every filter seed, and what an update cost.

    ``position_error`` (m) and ``yaw_error`` (rad, absolute) are (drives * seeds, T).
    """

    position_error: Floats
    yaw_error: Floats
    microseconds: float

    @property
    def position_rmse(self) -> Floats:
        """Position RMSE (m) of each drive."""
        rmse: Floats = np.sqrt(np.mean(self.position_error**2, axis=1))
        return rmse

    @property
    def yaw_rmse(self) -> Floats:
        """Yaw RMSE (rad) of each drive."""
        rmse: Floats = np.sqrt(np.mean(self.yaw_error**2, axis=1))
        return rmse

    @property
    def lost(self) -> int:
        """Drives with a position RMSE above ``LOST``."""
        return int((self.position_rmse > LOST).sum())

    def summary(self) -> dict[str, float]:
        """``rmse_mean``, ``_median``, ``_max`` (m), ``yaw_rmse`` (rad, mean), ``worst_error``
        (m, of any update), ``lost``, ``drives``, ``microseconds`` per update.
        """
        rmse = self.position_rmse
        return {
            "rmse_mean": float(rmse.mean()),
            "rmse_median": float(np.median(rmse)),
            "rmse_max": float(rmse.max()),
            "yaw_rmse": float(self.yaw_rmse.mean()),
            "worst_error": float(self.position_error.max()),
            "lost": float(self.lost),
            "drives": float(len(rmse)),
            "microseconds": self.microseconds,
        }


def rectangles_scenario(seed: int = 0, count: int = 25) -> Scenario:
    """A 33 x 20 m room with ``count`` solid rectangles of 0.25 to 1.5 m, nobody in it."""
    width, height = 33.0, 20.0
    rng = np.random.default_rng(seed)
    boxes = []
    for _ in range(count):
        size = rng.uniform(0.25, 1.5, 2)
        low = rng.uniform(0.5, np.array([width, height]) - 0.5 - size)
        boxes.append(Obstacle(box=(*map(float, low), *map(float, low + size))))
    anywhere = (0.5, 0.5, width - 0.5, height - 0.5)
    return Scenario(
        name="rectangles",
        size=(width, height),
        obstacles=boxes,
        pedestrians=Pedestrians(count=(0, 0)),
        robot=[RobotTask(start=anywhere, goal=anywhere)],
    )


def record_drives(
    place: Place,
    config: WorldConfig,
    drives: int = 10,
    updates: int = 200,
    speed: float = 0.6,
    seed: int = 1,
) -> list[Drive]:
    """Drive ``place`` at ``speed`` m/s, turning away from walls and people; fixed by ``seed``.

    Starts are the scenario's; slip is drawn anew for every update, as ``odometry_deviation`` says.
    """
    return [_record(place, config, updates, speed, seed, number) for number in range(drives)]


def _record(
    place: Place, config: WorldConfig, updates: int, speed: float, seed: int, number: int
) -> Drive:
    world = World(place, config)
    world.reset(seed, 0, number)
    rng = np.random.default_rng((seed, number))
    start = world.pose_true.copy()
    truth, odometry, ranges = [], [], []
    wish = 0.0
    for i in range(updates):
        if i % 20 == 0:
            wish = rng.uniform(-0.7, 0.7)
        world.begin_step(speed, _turn(place, world, speed, wish))
        world.tick()
        truth.append(world.pose_true.copy())
        odometry.append(world.pose_odometry.copy())
        ranges.append(world.scan().copy())
    return Drive(start, np.array(truth), np.array(odometry), np.array(ranges))


def _turn(place: Place, world: World, speed: float, wish: float) -> float:
    """The turn rate (rad/s) nearest to ``wish`` whose arc keeps clear, else the clearest."""
    enough = world.config.robot_radius + 0.15
    best, best_score = 0.0, -math.inf
    for turn in _TURNS:
        score = min(_room(place, world, speed, float(turn)), enough) * 100.0 - abs(turn - wish)
        if score > best_score:
            best, best_score = float(turn), score
    return best


def _room(place: Place, world: World, speed: float, turn: float) -> float:
    x, y, yaw = world.pose_true
    room = math.inf
    for t in _LOOK_AHEAD:
        middle = yaw + 0.5 * turn * t
        ahead = np.array([x + speed * t * math.cos(middle), y + speed * t * math.sin(middle)])
        room = min(room, place.room(ahead[0], ahead[1]))
        if world.pedestrian_count:
            people = world.pedestrian_position + t * world.pedestrian_velocity
            room = min(room, float(np.hypot(*(people - ahead).T).min()) - 0.3)
    return room


def kidnapped(first: Drive, second: Drive) -> Drive:
    """``first``, then without a word of the odometer ``second``: the robot was carried there."""
    x, y, yaw = first.odometry[-1]
    c, s = math.cos(yaw), math.sin(yaw)
    further = np.empty_like(second.odometry)
    further[:, 0] = x + c * second.odometry[:, 0] - s * second.odometry[:, 1]
    further[:, 1] = y + s * second.odometry[:, 0] + c * second.odometry[:, 1]
    further[:, 2] = np.remainder(yaw + second.odometry[:, 2] + math.pi, 2.0 * math.pi) - math.pi
    return Drive(
        first.start,
        np.concatenate([first.truth, second.truth]),
        np.concatenate([first.odometry, further]),
        np.concatenate([first.ranges, second.ranges]),
    )


def replay(
    drives: Sequence[Drive],
    grid: OccupancyGrid,
    config: LocalizationConfig,
    laser: LaserConfig,
    seeds: int = 5,
    start_deviation: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Outcome:
    """Every drive through a filter of ``config``, once per seed.

    The filter is told the true start plus a Gaussian error of ``start_deviation`` (m, m, rad).
    """
    field = LikelihoodMap.build(grid, config)
    amcl = AMCL(field, config, laser)
    stride = amcl_beam_stride(laser, config)
    bearings = beam_bearings(laser)[::stride].astype(np.float32)
    amcl.reset(drives[0].start, stream_state(0))
    amcl.update(drives[0].odometry[0], drives[0].ranges[0, ::stride], bearings)  # compiles
    position, yaw = [], []
    seconds = 0.0
    updates = 0
    for number, drive in enumerate(drives):
        ranges = np.ascontiguousarray(drive.ranges[:, ::stride])
        for seed in range(seeds):
            error = np.random.default_rng((seed, number)).normal(0.0, start_deviation)
            told = drive.start + error
            amcl.reset(told, stream_state(seed, number, 0, Stream.LOCALIZATION))
            estimates = np.empty_like(drive.truth)
            started = perf_counter()
            for i in range(len(ranges)):
                amcl.update(drive.odometry[i], ranges[i], bearings)
                estimates[i] = amcl.pose_estimated
            seconds += perf_counter() - started
            updates += len(ranges)
            wrong = estimates - drive.truth
            position.append(np.hypot(wrong[:, 0], wrong[:, 1]))
            yaw.append(np.abs(np.remainder(wrong[:, 2] + math.pi, 2.0 * math.pi) - math.pi))
    return Outcome(np.array(position), np.array(yaw), 1e6 * seconds / updates)
