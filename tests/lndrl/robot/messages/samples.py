"""A message of every type, as plain data; and the same bytes, recorded once."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from lndrl.robot.messages import (
    Clock,
    Content,
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
    names,
)

STAMP = 1_700_000_001_200_000_003
RECORDED: dict[str, str] = json.loads(Path(__file__).with_name("samples.json").read_text())
"""Type name to hexadecimal bytes, written by mcap-ros2-support 0.6.0."""


def turned(yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


SAMPLES: dict[str, Content] = {
    names.SCAN: Scan(
        STAMP, "laser", -1.5, 0.5, 0.15, 12.0,
        np.array([1.0, np.inf, np.nan, 0.0, 2.5], np.float32), 0.001, 0.1,
    ),
    names.ODOMETRY: Odometry(
        STAMP, "odom", "base_link", np.array([1.0, -2.0, 0.5]), np.array([0.3, -0.2])
    ),
    names.TF: Transforms(
        (
            Transform(STAMP, "map", "odom", np.array([1.0, 2.0, 0.0]), turned(2.5)),
            Transform(STAMP, "base_link", "laser", np.array([0.1, 0.0, 0.2]),
                      np.diag([1.0, -1.0, -1.0])),
        )
    ),
    names.MAP: GridMap(
        STAMP, "map", 0.05, np.array([-1.0, -2.0, 0.0]),
        np.array([[0, 100, -1], [0, 0, 50]], np.int8),
    ),
    names.POSE: StampedPose(STAMP, "map", np.array([1.0, 2.0, -3.0])),
    names.POSE_COVARIANCE: StampedPose(
        STAMP, "map", np.array([1.0, 2.0, 3.0]),
        np.array([[0.1, 0.01, 0.0], [0.01, 0.2, 0.02], [0.0, 0.02, 0.3]]),
    ),
    names.POSES: Poses(STAMP, "map", np.array([[1.0, 2.0, 0.1], [3.0, 4.0, -0.1]])),
    names.PEOPLE: People(
        STAMP, "odom", np.array([3, 7]), np.array([[1.0, 2.0], [3.0, 4.0]]),
        np.array([[0.5, 0.0], [-0.1, 0.2]]),
    ),
    names.TWIST: Velocity(0.4, -0.3),
    names.TWIST_STAMPED: Velocity(0.4, -0.3, STAMP, "base_link"),
    names.CLOCK: Clock(STAMP),
    names.TEXT: Words("scan_stale: wörter"),
    names.SWITCH: Switch(True),
    names.JOYSTICK: Joystick(STAMP, (0, 1, 0)),
}  # fmt: skip
