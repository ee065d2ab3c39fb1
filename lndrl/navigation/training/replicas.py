"""Replicas of the robot's filter: on the same drive, what other slip and other particles do.

Whether a drive gets the robot lost is mostly chance, and a drive shows one draw of it. Replicas
hear the robot's scans with an odometer and particles of their own, so each is another draw: what
part of them gets lost estimates the chance itself (conditional Monte Carlo: Asmussen & Glynn 2007,
"Stochastic Simulation", ch. V.4). A replica that is lost takes up the robot's belief again. The
robot never hears of them.

A filter is lost by a jump, and some twelve control steps before it errs in its heading, whoever
drives: ``heading_risk``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.config import LocalizationConfig, ReplicaConfig
from lndrl.kernels import kernel
from lndrl.localization.belief import Belief, belief_row, make_beliefs
from lndrl.navigation.reward import angle_error, is_lost
from lndrl.randomness import State, stream_state
from lndrl.world.odometry import draw_slip, drive

Floats = NDArray[np.float64]
RISK_ANGLE = 0.23
"""rad: of a filter that errs by e in its heading, (e / this)^3 are lost within ``RISK_STEPS``."""
RISK_STEPS = 12
"""Control steps over which that chance is paid, in equal parts."""


class Replicas(NamedTuple):
    """The replicas of many worlds: every array is (worlds, replicas of each, ...)."""

    beliefs: Belief
    odometry: Floats  # (worlds, n, 3) as ``Robot.odometry``
    slip: Floats  # (worlds, n, 2) as ``Robot.slip``
    random: State  # (worlds, n, 4) of their slip
    price: float  # of one that gets lost
    risk: float  # of the chance that one gets lost, for the robot's own and all of these together


def make_replicas(worlds: int, settings: ReplicaConfig, filters: LocalizationConfig) -> Replicas:
    """Replicas of ``worlds`` worlds, of which nothing is known yet: see ``take_up``."""
    count = settings.count
    flat: tuple[NDArray[Any], ...] = make_beliefs(worlds * count, filters)
    return Replicas(
        beliefs=Belief(*(array.reshape(worlds, count, *array.shape[1:]) for array in flat)),
        odometry=np.zeros((worlds, count, 3)),
        slip=np.ones((worlds, count, 2)),
        random=np.zeros((worlds, count, 4), np.uint64),
        price=settings.lost / max(count, 1),
        risk=settings.risk / (count + 1),
    )


def arrays_of(replicas: Replicas) -> tuple[NDArray[np.generic], ...]:
    """All that changes, each with a leading world dimension."""
    return (*replicas.beliefs, replicas.odometry, replicas.slip, replicas.random)


def draw_anew(replicas: Replicas, world: int, state: State) -> None:
    """Let the replicas of ``world`` draw from streams of their own below ``state`` (4,)."""
    for m in range(replicas.odometry.shape[1]):
        replicas.random[world, m] = stream_state(int(state[0]), m)
        replicas.beliefs.random[world, m] = stream_state(int(state[1]), m)


def take_up(replicas: Replicas, world: int, belief: Belief, odometry: Floats) -> None:
    """Let the replicas of ``world`` believe what ``belief`` does, at its ``odometry`` (3,)."""
    for mine, theirs, name in zip(replicas.beliefs, belief, Belief._fields, strict=True):
        if name != "random":
            mine[world] = theirs
    replicas.odometry[world] = odometry


@njit(inline="always")
def replica_row(beliefs, i, m):
    """Replica ``m`` of world ``i``, for kernels."""
    return Belief(
        beliefs.particles[i, m], beliefs.weights[i, m], beliefs.averages[i, m],
        beliefs.odometry[i, m], beliefs.pose[i, m], beliefs.covariance[i, m],
        beliefs.numbers[i, m], beliefs.random[i, m], beliefs.quality[i, m], beliefs.alpha[i, m],
    )  # fmt: skip


@kernel(_nrt=False, error_model="numpy")
def _take_up(mine, theirs):
    """``take_up`` for kernels, of one belief. Element by element: slices would count references."""
    for j in range(theirs.particles.shape[0]):
        for k in range(theirs.particles.shape[1]):
            for n in range(theirs.particles.shape[2]):
                mine.particles[j, k, n] = theirs.particles[j, k, n]
    for n in range(theirs.weights.size):
        mine.weights[n] = theirs.weights[n]
    for k in range(2):
        mine.averages[k] = theirs.averages[k]
    for k in range(3):
        mine.odometry[k] = theirs.odometry[k]
        mine.pose[k] = theirs.pose[k]
        for j in range(3):
            mine.covariance[k, j] = theirs.covariance[k, j]
    for k in range(theirs.numbers.size):
        mine.numbers[k] = theirs.numbers[k]
    for k in range(theirs.quality.size):
        mine.quality[k] = theirs.quality[k]


@njit(inline="always")
def slip_replicas(replicas, i, deviation):
    """Draw how much the wheels slip in what the replicas of world ``i`` hear."""
    for m in range(replicas.odometry.shape[1]):
        draw_slip(replicas.slip[i, m], deviation, replicas.random[i, m])


@njit(inline="always")
def move_replicas(replicas, i, velocity, time):
    """One tick of their odometers, as ``move_robot`` moves the robot's."""
    for m in range(replicas.odometry.shape[1]):
        slip = replicas.slip[i, m]
        drive(replicas.odometry[i, m], velocity[0] * slip[0], velocity[1] * slip[1], time)


@njit(inline="always")
def lost_replicas(replicas, i, robots, beliefs, limits):
    """How many replicas of world ``i`` are lost; they take up its belief again.

    ``limits``: distance (m) and angle (rad) from the truth.
    """
    pose_true, gone = robots.pose[i], 0
    for m in range(replicas.odometry.shape[1]):
        if not is_lost(pose_true, replicas.beliefs.pose[i, m], limits[0], limits[1]):
            continue
        gone += 1
        _take_up(replica_row(replicas.beliefs, i, m), belief_row(beliefs, i))
        for k in range(3):
            replicas.odometry[i, m, k] = robots.odometry[i, k]
    return gone


@njit(inline="always")
def heading_risk(pose_true, pose):
    """The chance that a filter whose ``pose`` (3,) errs so gets lost, for one control step.

    Fitted to how often filters of ``predictive``, ``careful`` and the shipped policy were lost
    within ``RISK_STEPS`` of such an error: docs/training.md.
    """
    ratio = angle_error(pose_true, pose) / RISK_ANGLE
    return min(ratio * ratio * ratio, 1.0) / RISK_STEPS


@njit(inline="always")
def risks(replicas, i, robots, beliefs):
    """``heading_risk`` of the filter of world ``i`` and of its replicas, added up."""
    total = heading_risk(robots.pose[i], beliefs.pose[i])
    for m in range(replicas.odometry.shape[1]):
        total += heading_risk(robots.pose[i], replicas.beliefs.pose[i, m])
    return total
