"""Which topics a robot has, by what they are for: ROS's usual names unless a user says others."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from lndrl.errors import UserError
from lndrl.robot.link import LATCHED, SENSOR, Quality, Topic
from lndrl.robot.messages import names


@dataclass(frozen=True)
class Topics:
    """Names of topics. ``people`` are SPENCER's tracks, ``people_poses`` poses alone."""

    scan: str = "/scan"
    odometry: str = "/odom"
    tf: str = "/tf"
    tf_static: str = "/tf_static"
    map: str = "/map"
    people: str = "/spencer/perception/tracked_persons"
    people_poses: str = "/people"
    robot_pose: str = "/amcl_pose"
    initial_pose: str = "/initialpose"
    goal: str = "/goal_pose"
    command: str = "/cmd_vel"
    clock: str = "/clock"
    own_pose: str = "/lndrl/pose"
    particles: str = "/lndrl/particles"
    status: str = "/lndrl/status"

    def renamed(self, changes: dict[str, str]) -> Topics:
        """With other names for some; raises UserError for what no topic is for."""
        known = [field.name for field in fields(self)]
        for name in changes:
            if name not in known:
                raise UserError(f"topic {name}: there is none for that; known: {', '.join(known)}")
        return replace(self, **changes)

    def within(self, namespace: str) -> Topics:
        """All of them below ``/namespace``, but for those that robots share: tf and the clock."""
        space = namespace.strip("/")
        if not space:
            return self
        shared = ("tf", "tf_static", "clock")
        return replace(
            self,
            **{
                field.name: f"/{space}{getattr(self, field.name)}"
                for field in fields(self)
                if field.name not in shared
            },
        )

    def topic(self, purpose: str, type_: str | None = None) -> Topic:
        """The topic for ``purpose``, of its usual type or ``type_``."""
        usual, quality = _TYPES[purpose]
        return Topic(getattr(self, purpose), type_ or usual, quality)


_RELIABLE = Quality()
_TYPES: dict[str, tuple[str, Quality]] = {
    "scan": (names.SCAN, SENSOR),
    "odometry": (names.ODOMETRY, _RELIABLE),
    "tf": (names.TF, Quality(depth=100)),
    "tf_static": (names.TF, LATCHED),
    "map": (names.MAP, LATCHED),
    "people": (names.PEOPLE, _RELIABLE),
    "people_poses": (names.POSES, _RELIABLE),
    "robot_pose": (names.POSE_COVARIANCE, LATCHED),
    "initial_pose": (names.POSE_COVARIANCE, _RELIABLE),
    "goal": (names.POSE, _RELIABLE),
    "command": (names.TWIST, _RELIABLE),
    "clock": (names.CLOCK, Quality(reliable=False, depth=1)),
    "own_pose": (names.POSE_COVARIANCE, _RELIABLE),
    "particles": (names.POSES, SENSOR),
    "status": (names.TEXT, LATCHED),
}
"""Type and quality of service that nav2 and its tools use for each."""
