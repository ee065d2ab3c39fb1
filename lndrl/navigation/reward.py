"""The six-part reward and the errors it is made of, as pure functions of arrays.

Poses are float64 (3,): x, y (m), yaw (rad) in the map frame. The parts are summed on every step,
the last one of an episode included; the indicators are independent of each other, as the
formula is printed. Source: PAPER §III-A3, parameters §6.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RewardConfig
from lndrl.kernels import kernel
from lndrl.navigation.observation import wrap_angle

REWARD_PARTS = ("approach", "pose", "arrive", "collide", "lost", "step")
"""Names of the parts, in the order of every array of parts."""


def reward_weights(reward: RewardConfig) -> NDArray[np.float64]:
    """The six weights (6,) in the order of ``REWARD_PARTS``."""
    return np.array([getattr(reward, part) for part in REWARD_PARTS], dtype=np.float64)


def pose_error_limit(reward: RewardConfig) -> float:
    """The pose error (m, rad) from which on it costs no more: infinite where nothing is limited.

    The error is cut, not the part's value: what a jump away costs, the way back pays, no more.
    Were the value cut, a jump away and a slow way back would earn something.
    """
    if reward.pose_limit is None or reward.pose == 0.0:
        return float("inf")
    return reward.pose_limit / abs(reward.pose)


@kernel(_nrt=False)
def goal_distance(pose, goal):
    """Metres from ``pose`` (3,) to ``goal`` (2,)."""
    return np.hypot(goal[0] - pose[0], goal[1] - pose[1])


@kernel(_nrt=False)
def position_error(pose_true, pose_estimated):
    """Metres between true and estimated position."""
    return np.hypot(pose_true[0] - pose_estimated[0], pose_true[1] - pose_estimated[1])


@kernel(_nrt=False)
def angle_error(pose_true, pose_estimated):
    """Radians in [0, pi] between true and estimated yaw."""
    return abs(wrap_angle(pose_true[2] - pose_estimated[2]))


@kernel(_nrt=False)
def pose_error(pose_true, pose_estimated):
    """Euclidean norm of (dx, dy, wrapped dyaw), metres and radians with equal weight."""
    position = position_error(pose_true, pose_estimated)
    return np.hypot(position, angle_error(pose_true, pose_estimated))


@kernel(_nrt=False)
def is_lost(pose_true, pose_estimated, lost_distance, lost_angle):
    """Whether the estimate is farther from the truth than either threshold (m, rad)."""
    return (
        position_error(pose_true, pose_estimated) > lost_distance
        or angle_error(pose_true, pose_estimated) > lost_angle
    )


@kernel(_nrt=False)
def has_arrived(pose_estimated, goal, arrive_distance):
    """Whether the ESTIMATED position lies within ``arrive_distance`` (m) of the goal."""
    return goal_distance(pose_estimated, goal) < arrive_distance


@kernel(_nrt=False)
def reward_parts(
    before,
    pose_true,
    report,
    variance,
    goal,
    arrived,
    collided,
    lost,
    weights,
    error_limit,
    out,
):
    """Write the six parts of one transition to ``out`` (6,), in the order of ``REWARD_PARTS``.

    ``before`` (3, 3) and ``report`` (9,) as in ``judge``; ``variance`` (3,) are the unclipped
    variances after the transition; ``arrived``, ``collided``, ``lost`` are booleans; ``weights``
    (6,) come from ``reward_weights``, ``error_limit`` from ``pose_error_limit``. Approach uses true
    positions, so a wrong belief earns nothing by itself.
    """
    approached = goal_distance(before[0], goal) - goal_distance(pose_true, goal)
    error_before = min(pose_error(before[2], before[1]), error_limit)
    error = min(pose_error(report[6:], report[:3]), error_limit)
    out[0] = weights[0] * approached / (1.0 + variance[0] + variance[1] + variance[2])
    out[1] = weights[1] * (error_before - error)
    out[2] = weights[2] if arrived else 0.0
    out[3] = weights[3] if collided else 0.0
    out[4] = weights[4] if lost else 0.0
    out[5] = weights[5]


@kernel(_nrt=False)
def judge(before, pose_true, report, variance, goal, collided, limits, weights, parts, sums):
    """Pay and judge one control step in a single call; returns (reward, lost, arrived).

    ``report`` (9,) is what is heard of the filter after the step: its pose, its variances, and the
    true pose that it is judged by. ``before`` (3, 3) are, before the step, the true pose, the pose
    that was heard and the true pose that it was judged by; ``limits`` the tuple (lost_distance,
    lost_angle, arrive_distance, error_limit). Writes ``parts`` (6,) and adds to ``sums`` (9,) the
    parts, the position and angle errors and the variances' sum; the errors are those of what is
    heard against where the robot is.
    """
    pose_estimated = report[:3]
    lost = is_lost(report[6:], pose_estimated, limits[0], limits[1])
    arrived = has_arrived(pose_estimated, goal, limits[2])
    reward_parts(
        before, pose_true, report, variance, goal, arrived, collided, lost, weights, limits[3],
        parts,
    )  # fmt: skip
    reward = 0.0
    for i in range(6):
        reward += parts[i]
        sums[i] += parts[i]
    sums[6] += position_error(pose_true, pose_estimated)
    sums[7] += angle_error(pose_true, pose_estimated)
    sums[8] += variance[0] + variance[1] + variance[2]
    return reward, lost, arrived
