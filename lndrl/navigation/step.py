"""A control step of many worlds as two compiled calls: drive and sense, then observe and judge.

Nothing here allocates and nothing asks Python, which would cost more than the work itself: what a
world is, believes and has earned are rows of arrays (``Robot``, ``People``, ``Belief``, ``Track``).

Small parts are inlined (``inline="always"``) and each large kernel is called in one place: numba
compiles and optimises whatever a function calls once more for that function.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.kernels import kernel
from lndrl.localization.belief import Belief, Field, Settings, belief_row
from lndrl.localization.belief import Scratch as FilterScratch
from lndrl.localization.bins import Bins
from lndrl.localization.update import update_belief
from lndrl.maps.edges import FaceScratch, RayMap
from lndrl.navigation.observation import goal_vector, pedestrians_in_view, push_scan
from lndrl.navigation.reward import REWARD_PARTS, judge
from lndrl.navigation.track import ARRIVED, COLLIDED, LOST, RUNNING, TIMEOUT, Track
from lndrl.navigation.training.replicas import (
    Replicas,
    lost_replicas,
    move_replicas,
    replica_row,
    risks,
    slip_replicas,
)
from lndrl.world.laser import Fan, ScanScratch, noisy_scan
from lndrl.world.orca_walls import Walls
from lndrl.world.people import CrowdParameters, People, Surroundings
from lndrl.world.people import Scratch as CrowdScratch
from lndrl.world.robot import Robot, take_command
from lndrl.world.world import Scratch as WorldScratch
from lndrl.world.world import Setting, tick_inline

Floats = NDArray[np.float64]
_LOST_PART = REWARD_PARTS.index("lost")


class Filter(NamedTuple):
    """What every world's localization shares."""

    scratch: FilterScratch
    bins: Bins
    limits: NDArray[np.int32]
    field: Field
    settings: Settings
    ranges: NDArray[np.float32]  # (beams used,) m, scratch
    bearings: NDArray[np.float32]  # (beams used,) rad
    stride: int  # every how many beams one is used
    perfect: bool  # the estimate is the truth
    heard: NDArray[np.bool_]  # (ticks per control step,) whether the filter updates after it


class Task(NamedTuple):
    """The numbers of the task."""

    ticks: int  # per control step
    steps_limit: int
    scan_scale: float  # counts per metre
    map_extent: float  # m
    variance_limit: float
    # lost distance (m), lost angle (rad), arrival (m), pose error that counts at most
    limits: tuple[float, float, float, float]
    weights: Floats  # (6,) of the reward's parts
    judges_report: bool  # against the truth that it describes, not the present one


class Views(NamedTuple):
    """Arrays of an ``Observation``."""

    scan: NDArray[np.uint16]
    pedestrians: NDArray[np.float32]
    pedestrian_count: NDArray[np.uint8]
    goal: NDArray[np.float32]


class Machine(NamedTuple):
    """Everything that the worlds of one place are and share, for ``pack``."""

    robots: Robot  # rows by world, like the next four
    people: People
    beliefs: Belief
    tracks: Track
    views: Views
    setting: Setting
    scratch: WorldScratch
    shared: Filter
    task: Task
    replicas: Replicas  # rows by world, too


def pack(arguments: Any) -> Any:
    """NamedTuples within NamedTuples to plain tuples.

    numba looks at every NamedTuple of a call from Python for about 4 us, at a hundred arrays in
    plain tuples for 10 in all.
    """
    return tuple(map(pack, arguments)) if isinstance(arguments, tuple) else arguments


@njit(inline="always")
def _setting(packed):
    around = packed[0]
    return Setting(
        Surroundings(around[0], around[1], Walls(*around[2])), Walls(*packed[1]),
        CrowdParameters(*packed[2]), RayMap(*packed[3]), Fan(*packed[4]),
        packed[5], packed[6], packed[7], packed[8], packed[9],
    )  # fmt: skip


@njit(inline="always")
def _scratch(packed):
    laser = packed[1]
    return WorldScratch(
        CrowdScratch(*packed[0]), ScanScratch(laser[0], laser[1], FaceScratch(*laser[2]))
    )


@njit(inline="always")
def _shared(packed):
    return Filter(
        FilterScratch(*packed[0]), Bins(*packed[1]), packed[2], Field(*packed[3]),
        Settings(*packed[4]), packed[5], packed[6], packed[7], packed[8], packed[9],
    )  # fmt: skip


@njit(inline="always")
def _replicas(packed):
    return Replicas(Belief(*packed[0]), packed[1], packed[2], packed[3], packed[4], packed[5])


@njit(inline="always")
def robot_row(robots, i):
    """World ``i`` of ``Robot`` arrays, for kernels."""
    return Robot(
        robots.pose[i], robots.odometry[i], robots.start[i], robots.goal[i], robots.command[i],
        robots.slip[i], robots.clock[i], robots.contact[i], robots.laser_random[i],
        robots.odometry_random[i], robots.deviation[i], robots.velocity[i],
    )  # fmt: skip


@njit(inline="always")
def people_row(people, i):
    """World ``i`` of ``People`` arrays, for kernels."""
    return People(
        people.position[i], people.velocity[i], people.route[i], people.route_length[i],
        people.target[i], people.direction[i], people.shuttle[i], people.model[i],
        people.heading[i], people.travelled[i], people.legs[i], people.count[i],
    )  # fmt: skip


@njit(inline="always")
def track_row(tracks, i):
    """World ``i`` of ``Track`` arrays, for kernels."""
    return Track(
        tracks.scan[i], tracks.before[i], tracks.variance[i], tracks.reward[i], tracks.parts[i],
        tracks.sums[i], tracks.distance[i], tracks.steps[i], tracks.outcome[i], tracks.reports[i],
        tracks.path[i], tracks.path_estimated[i],
    )  # fmt: skip


@njit(inline="always")
def _begin(robot, track, v, w):
    for k in range(3):
        track.before[0, k] = robot.pose[k]
        track.before[1, k] = track.reports[-1, k]
        track.before[2, k] = track.reports[-1, 6 + k]
    take_command(robot, v, w)


@kernel(_nrt=False)
def drive_worlds(machine, first, commands, ticks):
    """``ticks`` ticks of the worlds from ``first`` on, with ``commands`` (W, 2): m/s, rad/s.

    ``machine`` is a packed ``Machine``.

    After every tick that ``Filter.heard`` names, and always after the last, the filter hears
    odometry and laser; a collision ends a world's drive. The last scan is a full one. 0 ticks only
    sense, as an episode's start does. Worlds that the machine does not have are left out.
    """
    robots, crowds = Robot(*machine[0]), People(*machine[1])
    beliefs, tracks = Belief(*machine[2]), Track(*machine[3])
    setting, scratch, shared = _setting(machine[5]), _scratch(machine[6]), _shared(machine[7])
    replicas = _replicas(machine[9])
    for world in range(max(first, 0), min(first + len(commands), len(robots.pose))):
        robot, people = robot_row(robots, world), people_row(crowds, world)
        belief, track = belief_row(beliefs, world), track_row(tracks, world)
        if ticks > 0:
            command = commands[world - first]
            _begin(robot, track, command[0], command[1])
            slip_replicas(replicas, world, robot.deviation[0])
        for tick in range(max(ticks, 1)):
            if ticks > 0:
                x, y = robot.pose[0], robot.pose[1]
                tick_inline(robot, people, setting, scratch)
                if setting.odometry_per_reading:
                    slip_replicas(replicas, world, robot.deviation[0])
                move_replicas(replicas, world, robot.velocity, setting.tick)
                track.distance[0] += np.hypot(robot.pose[0] - x, robot.pose[1] - y)
            last = tick >= ticks - 1 or robot.contact[0] != 0
            if not last and (shared.perfect or not shared.heard[min(tick, len(shared.heard) - 1)]):
                continue
            # The policy never sees the scans between: only the beams that the filter uses are cast.
            stride = 1 if last else shared.stride
            noisy_scan(
                setting.rays, setting.fan, robot.pose, people.legs[: 2 * people.count[0]],
                setting.leg_radius, stride, robot.laser_random, scratch.laser,
                track.scan if last else shared.ranges,
            )  # fmt: skip
            if last:
                for k in range(len(shared.ranges)):
                    shared.ranges[k] = track.scan[k * shared.stride]
            if shared.perfect:
                for k in range(3):
                    belief.pose[k] = robot.pose[k]
            else:
                for m in range(replicas.odometry.shape[1] + 1):  # the robot's own filter is 0
                    update_belief(
                        robot.odometry if m == 0 else replicas.odometry[world, m - 1],
                        shared.ranges, shared.bearings,
                        belief if m == 0 else replica_row(replicas.beliefs, world, m - 1),
                        shared.scratch, shared.bins, shared.limits, shared.field,
                        shared.settings, last,
                    )  # fmt: skip
            if last:
                break


@njit(inline="always")
def _report(robots, beliefs, tracks, task, begun, i):
    """Let what the filter of world ``i`` says be heard: at once, or as many steps later as there
    are older reports. ``begun``: it has never said anything else. Beside each stands the truth that
    it is judged by."""
    reports = tracks.reports[i]
    for age in range(len(reports) - 1, 0, -1):
        for k in range(9):
            reports[age, k] = reports[age - 1, k]
    for k in range(3):
        reports[0, k] = beliefs.pose[i, k]
        reports[0, 3 + k] = beliefs.covariance[i, k, k]
        reports[0, 6 + k] = robots.pose[i, k]
    if begun:
        for age in range(1, len(reports)):
            for k in range(9):
                reports[age, k] = reports[0, k]
    if not task.judges_report:
        for k in range(3):
            reports[-1, 6 + k] = robots.pose[i, k]
    for k in range(3):
        tracks.variance[i, k] = reports[-1, 3 + k]


@njit(inline="always")
def _observe(robots, people, tracks, views, task, begun, i):
    """Write what world ``i`` shows to its row of the views; ``begun``: for the first time."""
    count = people.count[i, 0]
    push_scan(tracks.scan[i], task.scan_scale, begun, views.scan[i])
    goal_vector(
        tracks.reports[i, -1, :3], tracks.variance[i], robots.goal[i], robots.start[i, 2],
        task.variance_limit, views.goal[i],
    )  # fmt: skip
    views.pedestrian_count[i] = pedestrians_in_view(
        robots.pose[i], people.position[i, :count], people.velocity[i, :count],
        task.map_extent, views.pedestrians[i],
    )  # fmt: skip


@njit(inline="always")
def _pay(robots, beliefs, tracks, task, replicas, i):
    """Pay the step and see whether it ends the episode: collided, lost, arrived or timeout."""
    collided = robots.contact[i, 0] != 0
    tracks.reward[i, 0], lost, arrived = judge(
        tracks.before[i], robots.pose[i], tracks.reports[i, -1], tracks.variance[i],
        robots.goal[i], collided, task.limits, task.weights, tracks.parts[i], tracks.sums[i],
    )  # fmt: skip
    paid = replicas.risk * risks(replicas, i, robots, beliefs) if replicas.risk != 0.0 else 0.0
    paid += replicas.price * lost_replicas(replicas, i, robots, beliefs, task.limits)
    if paid != 0.0:
        tracks.parts[i, _LOST_PART] += paid
        tracks.sums[i, _LOST_PART] += paid
        tracks.reward[i, 0] += paid
    tracks.steps[i, 0] += 1
    if collided:
        outcome = COLLIDED
    elif lost:
        outcome = LOST
    elif arrived:
        outcome = ARRIVED
    else:
        outcome = TIMEOUT if tracks.steps[i, 0] >= task.steps_limit else RUNNING
    tracks.outcome[i, 0] = outcome


@kernel(_nrt=False)
def judge_worlds(machine, first, worlds, begun):
    """Observe ``worlds`` worlds from ``first`` on, and pay and judge what they have just driven.

    ``machine`` is a packed ``Machine``. Where ``begun`` is true the worlds have only started:
    there is nothing to pay. The paths keep the last point that they have room for.
    """
    robots, people = Robot(*machine[0]), People(*machine[1])
    beliefs, tracks = Belief(*machine[2]), Track(*machine[3])
    views, task, replicas = Views(*machine[4]), Task(*machine[8]), _replicas(machine[9])
    for i in range(max(first, 0), min(first + worlds, len(robots.pose))):
        _report(robots, beliefs, tracks, task, begun, i)
        _observe(robots, people, tracks, views, task, begun, i)
        if not begun:
            _pay(robots, beliefs, tracks, task, replicas, i)
        step = min(max(tracks.steps[i, 0], 0), tracks.path.shape[1] - 1)
        for k in range(2):
            tracks.path[i, step, k] = robots.pose[i, k]
            tracks.path_estimated[i, step, k] = tracks.reports[i, -1, k]
