"""What the messages of a robot say, as plain data: metres, radians, seconds, stamps in ns.

Planar: of a pose x, y and yaw are kept, of a velocity v and w. A frame is the robot's own name for
it, without a leading slash, which ROS 1 had.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SECOND = 1_000_000_000
"""ns."""


@dataclass(frozen=True)
class Scan:
    """A turn of a laser: beam i looks to ``angle_min + i * angle_increment`` in ``frame``."""

    stamp: int
    frame: str
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    ranges: NDArray[np.float32]
    time_increment: float = 0.0
    scan_time: float = 0.0


@dataclass(frozen=True)
class Odometry:
    """Where the wheels say that ``child`` is in ``frame``, and how fast it moves."""

    stamp: int
    frame: str
    child: str
    pose: Floats  # (3,)
    velocity: Floats = field(default_factory=lambda: np.zeros(2))  # (2,) v, w


@dataclass(frozen=True)
class Transform:
    """Where ``child`` is in ``parent``: a rotation matrix (3, 3) and a translation (3,) m."""

    stamp: int
    parent: str
    child: str
    translation: Floats
    rotation: Floats


@dataclass(frozen=True)
class Transforms:
    """A message of several transforms."""

    transforms: tuple[Transform, ...]


@dataclass(frozen=True)
class GridMap:
    """A map: ``cells`` int8 (rows, columns), row 0 the lowest y; -1 unknown, 0 free to 100."""

    stamp: int
    frame: str
    resolution: float
    origin: Floats  # (3,) of the lower left corner
    cells: NDArray[np.int8]


@dataclass(frozen=True)
class StampedPose:
    """A pose (3,), and its covariance (3, 3) of x, y, yaw where the message has one."""

    stamp: int
    frame: str
    pose: Floats
    covariance: Floats | None = None


@dataclass(frozen=True)
class Poses:
    """Poses (n, 3): particles, or people without velocities."""

    stamp: int
    frame: str
    poses: Floats


@dataclass(frozen=True)
class People:
    """Tracked people: ``ids`` (n,), positions and velocities over the ground (n, 2)."""

    stamp: int
    frame: str
    ids: NDArray[np.int64]
    position: Floats
    velocity: Floats


@dataclass(frozen=True)
class Velocity:
    """A command: v (m/s) and w (rad/s); ``stamp`` and ``frame`` where the message has them."""

    v: float
    w: float
    stamp: int = 0
    frame: str = ""


@dataclass(frozen=True)
class Clock:
    """The time of a simulation."""

    stamp: int


@dataclass(frozen=True)
class Words:
    """A line of text."""

    text: str


@dataclass(frozen=True)
class Switch:
    """A deadman's switch: held or not."""

    on: bool


@dataclass(frozen=True)
class Joystick:
    """A gamepad's buttons, 1 while held."""

    stamp: int
    buttons: tuple[int, ...]


Content = (
    Scan | Odometry | Transforms | GridMap | StampedPose | Poses | People | Velocity | Clock
    | Words | Switch | Joystick
)  # fmt: skip
