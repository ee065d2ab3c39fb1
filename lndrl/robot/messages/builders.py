"""From plain data to messages of rosbags, whose types are handed in."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from lndrl.robot.messages.content import SECOND, Floats
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

Types = Mapping[str, Any]

_PLANAR = (0, 1, 5)


def _time(types: Types, stamp: int) -> Any:
    return types["builtin_interfaces/msg/Time"](sec=stamp // SECOND, nanosec=stamp % SECOND)


def _header(types: Types, stamp: int, frame: str) -> Any:
    return types["std_msgs/msg/Header"](stamp=_time(types, stamp), frame_id=frame)


def _vector(types: Types, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return types["geometry_msgs/msg/Vector3"](x=float(x), y=float(y), z=float(z))


def _pose(types: Types, pose: Floats) -> Any:
    x, y, yaw = (float(value) for value in pose)
    return types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0),
        orientation=_heading(types, yaw),
    )


def _heading(types: Types, yaw: float) -> Any:
    quaternion = types["geometry_msgs/msg/Quaternion"]
    return quaternion(x=0.0, y=0.0, z=math.sin(0.5 * yaw), w=math.cos(0.5 * yaw))


def quaternion_of(rotation: Floats) -> tuple[float, float, float, float]:
    """x, y, z, w of a rotation matrix (3, 3), w at least 0."""
    r = rotation
    # The largest component first: none of the four roots is then of a small number.
    squares = 1.0 + np.array(
        [
            r[0, 0] - r[1, 1] - r[2, 2],
            -r[0, 0] + r[1, 1] - r[2, 2],
            -r[0, 0] - r[1, 1] + r[2, 2],
            r[0, 0] + r[1, 1] + r[2, 2],
        ]
    )
    k = int(squares.argmax())
    products = np.array(
        [
            [squares[0], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
            [r[0, 1] + r[1, 0], squares[1], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], squares[2], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], squares[3]],
        ]
    )
    q = products[k] / (2.0 * math.sqrt(squares[k]))
    x, y, z, w = (q if q[3] >= 0.0 else -q).tolist()
    return x, y, z, w


def _six(covariance: Floats | None) -> Floats:
    whole = np.zeros((6, 6))
    if covariance is not None:
        whole[np.ix_(_PLANAR, _PLANAR)] = covariance
    return whole.reshape(36)


def _twist(types: Types, v: float, w: float) -> Any:
    return types["geometry_msgs/msg/Twist"](linear=_vector(types, v), angular=_vector(types, z=w))


def _scan(types: Types, c: Any) -> Any:
    return types[SCAN](
        header=_header(types, c.stamp, c.frame),
        angle_min=c.angle_min,
        angle_max=c.angle_min + c.angle_increment * max(len(c.ranges) - 1, 0),
        angle_increment=c.angle_increment,
        time_increment=c.time_increment,
        scan_time=c.scan_time,
        range_min=c.range_min,
        range_max=c.range_max,
        ranges=np.ascontiguousarray(c.ranges, "<f4"),
        intensities=np.zeros(0, np.float32),
    )


def _odometry(types: Types, c: Any) -> Any:
    return types[ODOMETRY](
        header=_header(types, c.stamp, c.frame),
        child_frame_id=c.child,
        pose=types["geometry_msgs/msg/PoseWithCovariance"](_pose(types, c.pose), _six(None)),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](
            _twist(types, c.velocity[0], c.velocity[1]), _six(None)
        ),
    )


def _transforms(types: Types, c: Any) -> Any:
    quaternion = types["geometry_msgs/msg/Quaternion"]
    return types[TF](
        transforms=[
            types["geometry_msgs/msg/TransformStamped"](
                header=_header(types, each.stamp, each.parent),
                child_frame_id=each.child,
                transform=types["geometry_msgs/msg/Transform"](
                    translation=_vector(types, *each.translation),
                    rotation=quaternion(*quaternion_of(each.rotation)),
                ),
            )
            for each in c.transforms
        ]
    )


def _map(types: Types, c: Any) -> Any:
    rows, columns = c.cells.shape
    return types[MAP](
        header=_header(types, c.stamp, c.frame),
        info=types["nav_msgs/msg/MapMetaData"](
            map_load_time=_time(types, c.stamp),
            resolution=c.resolution,
            width=columns,
            height=rows,
            origin=_pose(types, c.origin),
        ),
        data=np.ascontiguousarray(c.cells, np.int8).reshape(-1),
    )


def _pose_stamped(types: Types, c: Any) -> Any:
    return types[POSE](header=_header(types, c.stamp, c.frame), pose=_pose(types, c.pose))


def _pose_covariance(types: Types, c: Any) -> Any:
    with_covariance = types["geometry_msgs/msg/PoseWithCovariance"]
    return types[POSE_COVARIANCE](
        header=_header(types, c.stamp, c.frame),
        pose=with_covariance(_pose(types, c.pose), _six(c.covariance)),
    )


def _poses(types: Types, c: Any) -> Any:
    poses = [_pose(types, each) for each in c.poses]
    return types[POSES](header=_header(types, c.stamp, c.frame), poses=poses)


def _people(types: Types, c: Any) -> Any:
    person = types["spencer_tracking_msgs/msg/TrackedPerson"]
    zero = types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
    tracks = []
    for number, at, speed in zip(c.ids, c.position, c.velocity, strict=True):
        heading = math.atan2(speed[1], speed[0])
        motion = types["geometry_msgs/msg/Twist"](
            linear=_vector(types, *speed), angular=_vector(types)
        )
        tracks.append(
            person(
                track_id=int(number),
                is_occluded=False,
                is_matched=True,
                detection_id=int(number),
                age=zero,
                pose=types["geometry_msgs/msg/PoseWithCovariance"](
                    _pose(types, np.array([*at, heading])), _six(None)
                ),
                twist=types["geometry_msgs/msg/TwistWithCovariance"](motion, _six(None)),
            )
        )
    return types[PEOPLE](header=_header(types, c.stamp, c.frame), tracks=tracks)


def _twist_stamped(types: Types, c: Any) -> Any:
    header = _header(types, c.stamp, c.frame)
    return types[TWIST_STAMPED](header=header, twist=_twist(types, c.v, c.w))


def _joystick(types: Types, c: Any) -> Any:
    return types[JOYSTICK](
        header=_header(types, c.stamp, ""),
        axes=np.zeros(0, np.float32),
        buttons=np.array(c.buttons, np.int32),
    )


BUILDERS: dict[str, Callable[[Types, Any], Any]] = {
    SCAN: _scan,
    ODOMETRY: _odometry,
    TF: _transforms,
    MAP: _map,
    POSE: _pose_stamped,
    POSE_COVARIANCE: _pose_covariance,
    POSES: _poses,
    PEOPLE: _people,
    TWIST: lambda types, c: _twist(types, c.v, c.w),
    TWIST_STAMPED: _twist_stamped,
    CLOCK: lambda types, c: types[CLOCK](clock=_time(types, c.stamp)),
    TEXT: lambda types, c: types[TEXT](data=c.text),
    SWITCH: lambda types, c: types[SWITCH](data=c.on),
    JOYSTICK: _joystick,
}
"""By type name: called with the types of a distribution and what the message says."""
