"""From messages as rosbags reads them to plain data; nothing here imports rosbags."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.robot.messages.content import (
    SECOND,
    Clock,
    Content,
    Floats,
    GridMap,
    Joystick,
    Odometry,
    People,
    Poses,
    Scan,
    StampedPose,
    Switch,
    Transform,
    Transforms,
    Velocity,
    Words,
)
from lndrl.robot.messages.names import (
    CLOCK,
    JOYSTICK,
    MAP,
    ODOMETRY,
    PEOPLE,
    POSE,
    POSE_COVARIANCE,
    POSES,
    SCAN,
    SWITCH,
    TEXT,
    TF,
    TWIST,
    TWIST_STAMPED,
)

_PLANAR = (0, 1, 5)
"""Rows of x, y and yaw in a covariance of six."""
_UNSET = 99999.0
"""Variances beyond it say that SPENCER does not know a component."""


def stamp_of(time: Any) -> int:
    """ns of a ROS time."""
    return int(time.sec) * SECOND + int(time.nanosec)


def yaw_of(q: Any) -> float:
    """Heading (rad) of a quaternion; NaN for one that is no rotation."""
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if not 1e-6 < norm < 1e6:
        return math.nan
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), norm - 2.0 * (q.y * q.y + q.z * q.z))


def rotation_of(q: Any) -> Floats:
    """The rotation matrix (3, 3) of a quaternion; NaN for one that is no rotation."""
    v = np.array([q.x, q.y, q.z, q.w], np.float64)
    norm = sum(each * each for each in v.tolist())  # of Python's floats: none overflows aloud
    if not 1e-6 < norm < 1e6:
        return np.full((3, 3), np.nan)
    x, y, z, w = v / math.sqrt(norm)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _frame(name: str) -> str:
    return name.lstrip("/")


def _pose(pose: Any) -> Floats:
    return np.array([pose.position.x, pose.position.y, yaw_of(pose.orientation)])


def _covariance(six: NDArray[np.float64]) -> Floats:
    whole = np.asarray(six, np.float64).reshape(6, 6)
    return whole[np.ix_(_PLANAR, _PLANAR)].copy()


def _read_scan(m: Any) -> Scan:
    ranges = np.array(m.ranges, np.float32)
    return Scan(
        stamp_of(m.header.stamp), _frame(m.header.frame_id), float(m.angle_min),
        float(m.angle_increment), float(m.range_min), float(m.range_max), ranges,
        float(m.time_increment), float(m.scan_time),
    )  # fmt: skip


def _read_odometry(m: Any) -> Odometry:
    twist = m.twist.twist
    return Odometry(
        stamp_of(m.header.stamp), _frame(m.header.frame_id), _frame(m.child_frame_id),
        _pose(m.pose.pose), np.array([twist.linear.x, twist.angular.z]),
    )  # fmt: skip


def _read_tf(m: Any) -> Transforms:
    return Transforms(
        tuple(
            Transform(
                stamp_of(each.header.stamp),
                _frame(each.header.frame_id),
                _frame(each.child_frame_id),
                np.array([getattr(each.transform.translation, axis) for axis in "xyz"]),
                rotation_of(each.transform.rotation),
            )
            for each in m.transforms
        )
    )


def _read_map(m: Any) -> GridMap:
    info = m.info
    cells = np.asarray(m.data, np.int8)
    if cells.size == info.width * info.height:
        cells = cells.reshape(int(info.height), int(info.width))
    resolution = float(str(np.float32(info.resolution)))  # 0.05, which single precision has not
    return GridMap(
        stamp_of(m.header.stamp), _frame(m.header.frame_id), resolution,
        _pose(info.origin), cells.copy(),
    )  # fmt: skip


def _read_pose(m: Any) -> StampedPose:
    return StampedPose(stamp_of(m.header.stamp), _frame(m.header.frame_id), _pose(m.pose))


def _read_pose_covariance(m: Any) -> StampedPose:
    return StampedPose(
        stamp_of(m.header.stamp), _frame(m.header.frame_id), _pose(m.pose.pose),
        _covariance(m.pose.covariance),
    )  # fmt: skip


def _read_poses(m: Any) -> Poses:
    poses = np.array([_pose(each) for each in m.poses]).reshape(-1, 3)
    return Poses(stamp_of(m.header.stamp), _frame(m.header.frame_id), poses)


def _read_people(m: Any) -> People:
    rows = []
    for track in m.tracks:
        speed, where = track.twist.twist.linear, track.pose.pose.position
        known = np.asarray(track.twist.covariance, np.float64)[[0, 7]] <= _UNSET
        rows.append((where.x, where.y, speed.x * known[0], speed.y * known[1]))
    found = np.array(rows, np.float64).reshape(-1, 4)
    ids = np.array([int(track.track_id) % 2**63 for track in m.tracks], np.int64)
    header = m.header
    return People(stamp_of(header.stamp), _frame(header.frame_id), ids, found[:, :2], found[:, 2:])


def _read_twist(m: Any) -> Velocity:
    return Velocity(float(m.linear.x), float(m.angular.z))


def _read_twist_stamped(m: Any) -> Velocity:
    stamp, frame = stamp_of(m.header.stamp), _frame(m.header.frame_id)
    return Velocity(float(m.twist.linear.x), float(m.twist.angular.z), stamp, frame)


READERS: dict[str, Callable[[Any], Content]] = {
    SCAN: _read_scan,
    ODOMETRY: _read_odometry,
    TF: _read_tf,
    MAP: _read_map,
    POSE: _read_pose,
    POSE_COVARIANCE: _read_pose_covariance,
    POSES: _read_poses,
    PEOPLE: _read_people,
    TWIST: _read_twist,
    TWIST_STAMPED: _read_twist_stamped,
    CLOCK: lambda m: Clock(stamp_of(m.clock)),
    TEXT: lambda m: Words(str(m.data)),
    SWITCH: lambda m: Switch(bool(m.data)),
    JOYSTICK: lambda m: Joystick(stamp_of(m.header.stamp), tuple(int(b) for b in m.buttons)),
}
