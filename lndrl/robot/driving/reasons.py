"""Why a robot stands, each with a name: published, shown, and explained in docs/robot.md."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, unique


@unique
class Reason(Enum):
    """A reason to stand; the value says what to do about it. Earlier ones are shown first."""

    INTERRUPTED = "start lndrl drive again"
    PLANNER_FAILED = "the planner cannot go on; end this and mend it, or take another"
    LINK_LOST = "check the network and the robot's Zenoh router; it goes on by itself"
    NOT_ENABLED = "hold the switch of --enable-topic"
    WRONG_TYPE = "give another topic (--topic scan=/NAME), or let the robot publish that type"
    WRONG_DISTRIBUTION = "give the robot's distribution: --distribution humble, jazzy or kilted"
    UNREADABLE = "the topic must carry what its type says; check its publisher"
    CLOCK_STOPPED = "let the simulation go on"
    CLOCKS_DISAGREE = "set both clocks, e.g. by chrony, or give --sim-time on in a simulation"
    TIME_JUMPED = "give the pose again: RViz's 2D Pose Estimate, or --pose"
    NO_SCAN = "start the scanner's driver; lndrl drive names the topic that it listens to"
    SCAN_STALE = "check the scanner and the network; it goes on by itself"
    SCAN_INVALID = "the scanner's driver must give finite angles and ranges"
    SCAN_BLIND = "uncover the scanner; nearly no beam says anything"
    SCAN_CHANGED = "the scanner must keep its number of beams and its range; it goes on by itself"
    NO_SCANNER_POSE = "publish the scanner's frame on /tf_static, or give --scanner X,Y,YAW"
    NO_ODOMETRY = "start the base's driver; lndrl drive names the topic that it listens to"
    ODOMETRY_STALE = "check the base and the network; it goes on by itself"
    ODOMETRY_INVALID = "the base's driver must give finite poses"
    ODOMETRY_JUMPED = "see to the wheels, then give the pose again, by RViz's 2D Pose Estimate"
    NO_MAP = "start a map server (nav2_map_server), or give --map FILE.yaml"
    MAP_INVALID = "publish a map with a size, a resolution and free cells"
    MAP_FRAME = "publish the map in the frame that poses are given in"
    NO_POSE = "give one: RViz's 2D Pose Estimate, --pose X,Y,YAW, or the robot's own AMCL"
    POSE_FRAME = "give the pose in the map's frame"
    POSE_INVALID = "give a finite pose on the map's floor"
    POSE_STALE = "check the robot's localization and the network; it goes on by itself"
    POSE_LOST = "give the pose again: RViz's 2D Pose Estimate"
    POSE_INCONSISTENT = "give the pose again, or the map of where the robot is"
    PEOPLE_STALE = "check the people tracker, or drive without it: --people none"
    PEOPLE_FRAME = "the tracker must publish in the map's, the odometry's or the base's frame"
    GOAL_FRAME = "give the goal in the map's, the odometry's or the base's frame"
    GOAL_OFF_MAP = "give a goal on the map"
    GOAL_IN_WALL = "give a goal on free floor, farther from walls"
    GOAL_UNREACHABLE = "give a goal that the floor connects with the robot"
    GUARDED = "what is in its way must leave, or be nearer to the map's walls; it goes on by itself"
    ARRIVED = "give another goal"
    NO_GOAL = "give one: RViz's 2D Goal Pose, or --goal X,Y"

    @property
    def label(self) -> str:
        """The name that is published: ``scan_stale``."""
        return self.name.lower()

    @property
    def is_rest(self) -> bool:
        """Whether nothing is wrong: there is only nothing to do."""
        return self in (Reason.ARRIVED, Reason.NO_GOAL)


@dataclass(frozen=True)
class Stop:
    """A reason that holds now, and in words what was seen."""

    reason: Reason
    words: str

    def __str__(self) -> str:
        return f"{self.reason.label}: {self.words}; {self.reason.value}"


def in_order(stops: dict[Reason, str]) -> tuple[Stop, ...]:
    """Those that hold, the one to mend first at the front."""
    return tuple(Stop(reason, stops[reason]) for reason in Reason if reason in stops)
