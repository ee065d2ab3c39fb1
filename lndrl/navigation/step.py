"""A control step of many worlds as two compiled calls: drive and sense, then observe and judge.

Nothing here allocates and nothing asks Python, which would cost more than the work itself: what a
world is, believes and has earned are rows of arrays (``Robot``, ``People``, ``Belief``, ``Track``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.localization.belief import Belief, Field, Settings
from lndrl.localization.belief import Scratch as FilterScratch
from lndrl.localization.bins import Bins
from lndrl.localization.update import update_belief
from lndrl.navigation.observation import _quantise, goal_vector, pedestrians_in_view
from lndrl.navigation.reward import judge
from lndrl.navigation.track import ARRIVED, COLLIDED, LOST, RUNNING, TIMEOUT, Track
from lndrl.world.people import People
from lndrl.world.robot import Robot, take_command
from lndrl.world.world import scan_world, tick_world

Floats = NDArray[np.float64]


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


class Task(NamedTuple):
    """The numbers of the task."""

    ticks: int  # per control step
    steps_limit: int
    scan_scale: float  # counts per metre
    map_extent: float  # m
    variance_limit: float
    limits: tuple[float, float, float]  # lost distance (m), lost angle (rad), arrival (m)
    weights: Floats  # (6,) of the reward's parts


class Views(NamedTuple):
    """Arrays of an ``Observation``."""

    scan: NDArray[np.uint16]
    pedestrians: NDArray[np.float32]
    pedestrian_count: NDArray[np.uint8]
    goal: NDArray[np.float32]


@njit(cache=True, nogil=True)
def _robot(robots, i):
    return Robot(
        robots.pose[i], robots.odometry[i], robots.start[i], robots.goal[i], robots.command[i],
        robots.slip[i], robots.clock[i], robots.contact[i], robots.laser_random[i],
        robots.odometry_random[i],
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _people(people, i):
    return People(
        people.position[i], people.velocity[i], people.route[i], people.route_length[i],
        people.target[i], people.direction[i], people.shuttle[i], people.model[i],
        people.heading[i], people.travelled[i], people.legs[i], people.count[i],
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _belief(beliefs, i):
    return Belief(
        beliefs.particles[i], beliefs.weights[i], beliefs.averages[i], beliefs.odometry[i],
        beliefs.pose[i], beliefs.covariance[i], beliefs.numbers[i], beliefs.random[i],
        beliefs.quality[i],
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _track(tracks, i):
    return Track(
        tracks.scan[i], tracks.before[i], tracks.variance[i], tracks.reward[i], tracks.parts[i],
        tracks.sums[i], tracks.distance[i], tracks.steps[i], tracks.outcome[i], tracks.path[i],
        tracks.path_estimated[i],
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _localize(robot, belief, shared):
    """Tell the filter odometry and ``shared.ranges``."""
    if shared.perfect:
        belief.pose[:] = robot.pose
        return
    update_belief(
        robot.odometry, shared.ranges, shared.bearings, belief, shared.scratch, shared.bins,
        shared.limits, shared.field, shared.settings,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def sense(robot, people, belief, track, setting, scratch, shared):
    """A full scan, and its share for the localization."""
    scan_world(robot, people, setting, scratch, 1, track.scan)
    for k in range(len(shared.ranges)):
        shared.ranges[k] = track.scan[k * shared.stride]
    _localize(robot, belief, shared)
    for k in range(3):
        track.variance[k] = belief.covariance[k, k]


@njit(cache=True, nogil=True)
def _drive(robot, people, belief, track, v, w, setting, scratch, shared, ticks):
    """Run the ticks of one control step; a collision ends it."""
    for k in range(3):
        track.before[0, k] = robot.pose[k]
        track.before[1, k] = belief.pose[k]
    take_command(robot, v, w, setting.odometry_deviation)
    for tick in range(ticks):
        x = robot.pose[0]
        y = robot.pose[1]
        tick_world(robot, people, setting, scratch)
        track.distance[0] += np.hypot(robot.pose[0] - x, robot.pose[1] - y)
        if robot.contact[0] != 0 or tick == ticks - 1:
            sense(robot, people, belief, track, setting, scratch, shared)
            break
        if not shared.perfect:
            # The policy never sees these scans: only the beams that the filter uses are cast.
            scan_world(robot, people, setting, scratch, shared.stride, shared.ranges)
            _localize(robot, belief, shared)


@njit(cache=True, nogil=True)
def drive_worlds(robots, people, beliefs, tracks, commands, setting, scratch, shared, ticks):
    """One control step of W worlds with ``commands`` (W, 2): v (m/s), w (rad/s)."""
    for i in range(len(commands)):
        _drive(
            _robot(robots, i), _people(people, i), _belief(beliefs, i), _track(tracks, i),
            commands[i, 0], commands[i, 1], setting, scratch, shared, ticks,
        )  # fmt: skip


@njit(cache=True, nogil=True)
def observe_worlds(robots, people, beliefs, tracks, views, task):
    """Write what W worlds show to their rows of ``views``."""
    for i in range(len(robots.pose)):
        count = people.count[i, 0]
        _quantise(tracks.scan[i], task.scan_scale, views.scan[i])
        goal_vector(
            beliefs.pose[i], tracks.variance[i], robots.goal[i], robots.start[i, 2],
            task.variance_limit, views.goal[i],
        )  # fmt: skip
        views.pedestrian_count[i] = pedestrians_in_view(
            robots.pose[i], people.position[i, :count], people.velocity[i, :count],
            task.map_extent, views.pedestrians[i],
        )  # fmt: skip


@njit(cache=True, nogil=True)
def _conclude(robot, belief, track, task):
    """Pay the step and see whether it ends the episode: collided, lost, arrived or timeout."""
    collided = robot.contact[0] != 0
    track.reward[0], lost, arrived = judge(
        track.before, robot.pose, belief.pose, track.variance, robot.goal, collided,
        task.limits, task.weights, track.parts, track.sums,
    )  # fmt: skip
    track.steps[0] += 1
    note_path(robot, belief, track)
    if collided:
        track.outcome[0] = COLLIDED
    elif lost:
        track.outcome[0] = LOST
    elif arrived:
        track.outcome[0] = ARRIVED
    else:
        track.outcome[0] = TIMEOUT if track.steps[0] >= task.steps_limit else RUNNING


@njit(cache=True, nogil=True)
def note_path(robot, belief, track):
    """Write down where the robot is and where it believes to be after ``track.steps``."""
    for k in range(2):
        track.path[track.steps[0], k] = robot.pose[k]
        track.path_estimated[track.steps[0], k] = belief.pose[k]


@njit(cache=True, nogil=True)
def judge_worlds(robots, people, beliefs, tracks, views, task):
    """Observe, pay and judge the control step that W worlds have just driven."""
    observe_worlds(robots, people, beliefs, tracks, views, task)
    for i in range(len(robots.pose)):
        _conclude(_robot(robots, i), _belief(beliefs, i), _track(tracks, i), task)


@njit(cache=True, nogil=True)
def start_track(robot, people, belief, track, setting, scratch, shared):
    """Begin an episode's track with a first scan; world and filter have been reset."""
    track.sums[:] = 0.0
    track.distance[0] = 0.0
    track.steps[0] = 0
    track.outcome[0] = RUNNING
    sense(robot, people, belief, track, setting, scratch, shared)
    note_path(robot, belief, track)
