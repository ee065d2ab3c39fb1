"""The ROS 2 messages that are spoken: plain data, names of types, bytes of a distribution."""

from lndrl.robot.messages.content import (
    SECOND,
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
)
from lndrl.robot.messages.store import (
    DISTRIBUTIONS,
    NO_HASH,
    BadMessageError,
    MessageStore,
    missing_extra,
)

__all__ = [
    "DISTRIBUTIONS",
    "NO_HASH",
    "SECOND",
    "BadMessageError",
    "Clock",
    "Content",
    "GridMap",
    "Joystick",
    "MessageStore",
    "Odometry",
    "People",
    "Poses",
    "Scan",
    "StampedPose",
    "Switch",
    "Transform",
    "Transforms",
    "Velocity",
    "Words",
    "missing_extra",
]
