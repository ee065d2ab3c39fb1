"""All that a robot has said, as far as it can be believed, and what is wrong with the rest."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.localization import Scanner
from lndrl.robot.driving.belief import Estimate, Localization
from lndrl.robot.driving.frames import Frames, mounted, planar
from lndrl.robot.driving.maps import MapFaultError, RobotMap
from lndrl.robot.driving.odometry import Wheels
from lndrl.robot.driving.people import Follower, Seen, seen
from lndrl.robot.driving.pilot import in_base
from lndrl.robot.driving.reasons import Reason
from lndrl.robot.driving.scans import BaseScan, about_base, fault, scanner_of
from lndrl.robot.driving.skew import at_one_moment
from lndrl.robot.geometry import wrapped
from lndrl.robot.messages import (
    SECOND,
    Content,
    GridMap,
    Joystick,
    Odometry,
    People,
    Poses,
    Scan,
    StampedPose,
    Switch,
    Transforms,
)

Floats = NDArray[np.float64]
Fault = tuple[Reason, str]

_BACK = SECOND
"""ns by which a stamp may be before the last one: messages overtake each other, clocks jump."""
_PEOPLE_AHEAD = 0.5
"""s by which people are walked on at most, from their stamp to the scan's."""
_MOST_WAITING = 8
"""Scans that wait for the odometry of their moment."""
_MOUNTED = (0.05, 0.05)
"""m and rad by which a scanner may stand off where TF has it."""
_HELD = 0.5
"""s for which a switch counts as held without saying so again."""


@dataclass(frozen=True)
class Trust:
    """How old what is driven by may be (s): scan and odometry ``stale``, people ``people_stale``;
    ``clocks``: how far apart stamps and our clock may be.
    """

    stale: float = 0.35
    people_stale: float = 1.0
    clocks: float = 1.0


class Senses:
    """The newest of everything. ``now`` is s of a clock that never jumps; ``clock`` ns of the one
    that stamps are by, None where there is none to compare with.

    ``mount`` (how the scanner stands) and ``map_``, where given, are believed rather than the
    robot's; ``limits`` (m, least and most) hold beside those that a scan says. ``button``: of a
    joystick that enables.
    """

    def __init__(
        self,
        localization: Localization,
        robot_radius: float,
        trust: Trust | None = None,
        mount: Scanner | None = None,
        limits: tuple[float, float] | None = None,
        map_: RobotMap | None = None,
        enabling: bool = False,
        button: int = 0,
    ) -> None:
        self.localization, self.trust = localization, trust or Trust()
        self.wheels, self.frames = Wheels(), Frames()
        self.estimate: Estimate | None = None
        self.scan: BaseScan | None = None
        self.goal: StampedPose | None = None
        self.robot_said: StampedPose | None = None
        self.radius, self._mount, self._limits = robot_radius, mount, limits
        self._enabling, self._button, self._enabled_at = enabling, button, -np.inf
        self._given_map = map_ is not None
        self.map: RobotMap | None = None
        self._last: dict[str, tuple[float, float]] = {}  # arrival (s), age at that (s)
        self._stamps: dict[str, int] = {}
        self._before: Scan | None = None
        self._waiting: deque[Scan] = deque(maxlen=_MOST_WAITING)
        self._people: Seen | None = None
        self._follower = Follower()
        self._faults: dict[str, Fault | None] = {}  # by purpose, until it speaks again
        self._jumped: Fault | None = None  # until somebody gives a pose
        self.mount_doubt = ""
        """Where TF says that the scanner stands, if not where ``mount`` does."""
        if map_ is not None:
            self._enter(map_)
        self._takers: dict[str, Callable[[Any, float], None]] = {
            "scan": self._take_scan,
            "odometry": self._take_odometry,
            "tf": self._take_transforms,
            "tf_static": self._take_transforms,
            "map": self._take_map,
            "people": self._take_people,
            "people_poses": self._take_poses,
            "robot_pose": self._take_robot_pose,
            "initial_pose": self._take_initial_pose,
            "goal": self._take_goal,
            "enable": self._take_enable,
        }

    @property
    def base(self) -> str:
        """The base's frame, as the odometry calls it."""
        return self.wheels.child or "base_link"

    def take(self, purpose: str, content: Content, now: float, clock: int | None) -> bool:
        """Take in a message; whether it has led to a new ``estimate``."""
        before = self.estimate
        stamp = getattr(content, "stamp", 0)
        age = 0.0 if clock is None or not stamp else (clock - stamp) / SECOND
        self._last[purpose] = now, age
        self._faults[purpose] = None
        if purpose in ("scan", "odometry"):
            self._check_order(purpose, stamp)
        self._takers[purpose](content, now)
        return self.estimate is not before

    def unreadable(self, purpose: str, reason: Reason, words: str, now: float) -> None:
        """A message for ``purpose`` came that cannot be taken."""
        self._faults[purpose] = reason, words

    def give_pose(self, pose: StampedPose) -> None:
        """A user says where the robot is."""
        self._faults["initial_pose"] = None
        self._take_initial_pose(pose, 0.0)

    def people(self) -> Seen | None:
        """People about the base at the scan's moment; None where nobody tracks any."""
        people, estimate = self._people, self.estimate
        if people is None or estimate is None:
            return None
        ahead = np.clip((estimate.stamp - people.stamp) / SECOND, -_PEOPLE_AHEAD, _PEOPLE_AHEAD)
        walked = Seen(
            people.stamp, people.frame, people.position + ahead * people.velocity, people.velocity
        )
        pose = self._base_in(people.frame)
        return None if pose is None else in_base(walked, pose)

    def goal_in_map(self) -> Floats | Fault | None:
        """Where the goal (2,) is in the map, or why that is not known."""
        goal = self.goal
        if goal is None or self.map is None or self.estimate is None:
            return None
        if not np.isfinite(goal.pose[:2]).all():
            return Reason.GOAL_OFF_MAP, "the goal is not finite"
        if goal.frame in ("", self.map.frame):
            return goal.pose[:2]
        base = self._base_in(goal.frame)
        if base is None:
            return Reason.GOAL_FRAME, f"the goal is in the frame {goal.frame}"
        here = self.estimate.pose
        dx, dy = goal.pose[:2] - base[:2]
        turn = here[2] - base[2]
        c, s = np.cos(turn), np.sin(turn)
        return here[:2] + np.array([c * dx - s * dy, s * dx + c * dy])

    def stops(self, now: float) -> dict[Reason, str]:
        """What is wrong at ``now``; goals are the driver's to judge."""
        found: dict[Reason, str] = {}
        for each in self._faults.values():
            if each is not None:
                found.setdefault(*each)
        if self._jumped is not None:
            found.setdefault(*self._jumped)
        self._ages(now, found)
        if self.map is None and not any(r.name.startswith("MAP_") for r in found):
            found[Reason.NO_MAP] = "no map has come"
        if self.localization.fault is not None:
            found.setdefault(*self.localization.fault)
        elif self.estimate is None:
            found[Reason.NO_POSE] = "nobody has said where the robot is"
        elif self._people is not None and self._base_in(self._people.frame) is None:
            found[Reason.PEOPLE_FRAME] = f"people are in the frame {self._people.frame}"
        if self._enabling and now - self._enabled_at > _HELD:
            found[Reason.NOT_ENABLED] = "the switch is not held"
        return found

    def age(self, purpose: str, now: float) -> float | None:
        """s since what ``purpose`` last said was so; None where it never spoke."""
        if purpose not in self._last:
            return None
        at, age = self._last[purpose]
        # A clock that is wrong says nothing of ages: the time since it came is all there is.
        return now - at + (max(age, 0.0) if abs(age) <= self.trust.clocks else 0.0)

    def scan_age(self, now: float) -> float | None:
        """s since ``scan`` was so; newer ones may wait for their odometry, or be of no use."""
        age = self.age("scan", now)
        if age is None or self.scan is None:
            return None
        return age + max(self._stamps.get("scan", 0) - self.scan.stamp, 0) / SECOND

    def _ages(self, now: float, found: dict[Reason, str]) -> None:
        needed = (
            ("scan", Reason.NO_SCAN, Reason.SCAN_STALE, "scan"),
            ("odometry", Reason.NO_ODOMETRY, Reason.ODOMETRY_STALE, "odometry"),
        )
        for purpose, missing, stale, word in needed:
            age = self.age(purpose, now)
            if age is None:
                found[missing] = f"no {word} has come"
                continue
            if age > self.trust.stale:
                found[stale] = f"the last {word} is {age:.2f} s old"
            off = self._last[purpose][1]
            if abs(off) > self.trust.clocks:
                sense = "behind" if off > 0.0 else "ahead of"
                found[Reason.CLOCKS_DISAGREE] = (
                    f"the {word}'s stamps are {abs(off):.1f} s {sense} the clock here"
                )
        self._check_apart(found)
        for purpose in ("people", "people_poses"):
            age = self.age(purpose, now)
            if age is not None and age > self.trust.people_stale:
                found[Reason.PEOPLE_STALE] = f"people were last tracked {age:.1f} s ago"

    def _check_apart(self, found: dict[Reason, str]) -> None:
        """Scan and odometry, both fresh, must speak of the same moments."""
        scan, odometry = (self._stamps.get(each) for each in ("scan", "odometry"))
        stale = {Reason.SCAN_STALE, Reason.ODOMETRY_STALE} & set(found)
        if scan is None or odometry is None or stale:
            return
        apart = abs(scan - odometry) / SECOND
        behind = 0.0 if self.estimate is None else (scan - self.estimate.stamp) / SECOND
        if apart > self.trust.clocks or behind > self.trust.stale:
            words = f"scan and odometry are stamped {max(apart, behind):.2f} s apart"
            found.setdefault(Reason.CLOCKS_DISAGREE, words)

    def _check_order(self, purpose: str, stamp: int) -> None:
        last = self._stamps.get(purpose)
        self._stamps[purpose] = stamp
        if last is not None and stamp < last - _BACK:
            back = (last - stamp) / SECOND
            self._lose(Reason.TIME_JUMPED, f"stamps of the {purpose} went back by {back:.1f} s")
            self.wheels.clear()
            self._stamps, self._people = {purpose: stamp}, None
            self._waiting.clear()
            self._follower = Follower()

    def _lose(self, reason: Reason, words: str) -> None:
        """The belief is of no use any more."""
        self._jumped = reason, words
        self.localization.forget()
        self.localization.fault = None
        self.estimate = self.scan = None

    def _take_scan(self, scan: Scan, now: float) -> None:
        wrong = fault(scan, self._before)
        if wrong is None or wrong[0] is Reason.SCAN_CHANGED:
            self._before = scan
        if wrong is not None:
            self._faults["scan"] = wrong
            # A scan that shows nothing still says that time has passed: the belief grows wider.
            if wrong[0] is not Reason.SCAN_BLIND:
                return
        self._waiting.append(scan)
        self._localize()

    def _localize(self) -> None:
        """Take the scans that wait into the belief, as far as the odometry has come."""
        while self._waiting:
            scan = self._waiting[0]
            if self._mount is None and not self.wheels.child:
                return  # nobody has said yet how the base's frame is called
            scanner = self._scanner(scan)
            passed = self.scan is not None and scan.stamp <= self.scan.stamp
            if scanner is None or passed:  # a later one came first
                self._waiting.popleft()
                continue
            if self.wheels.at(scan.stamp) is None:
                if (last := self.wheels.stamp) is None or scan.stamp > last:
                    return
                self._waiting.popleft()  # from before all that the wheels remember
                continue
            self._waiting.popleft()
            self.scan = about_base(at_one_moment(scan, scanner, self.wheels), scanner)
            self.estimate = self.localization.update(self.scan, self.wheels)
            if self.estimate is not None:
                self._jumped = None

    def _scanner(self, scan: Scan) -> Scanner | None:
        """How the scanner of ``scan`` stands and sees; None, and a fault, where that is unknown."""
        mount, self._faults["mounting"] = self._mount, None
        if mount is None:
            frame = scan.frame or self.base
            matrix = self.frames.find(self.base, frame)
            if matrix is None:
                words = f"no transform leads from {self.base} to the scan's frame {frame}"
                self._faults["mounting"] = Reason.NO_SCANNER_POSE, words
                return None
            mount = mounted(matrix)
        else:
            self.mount_doubt = self._elsewhere(mount, scan.frame)
        found = scanner_of(scan, mount, self._limits)
        if found is None and self._limits is not None:
            least, most = self._limits
            self._faults["mounting"] = (
                Reason.SCAN_INVALID,
                f"a scan reaches from {scan.range_min:g} m to {scan.range_max:g} m, by the robot's "
                f"file it reaches from {least:g} m to {most:g} m",
            )
        return found

    def _elsewhere(self, mount: Scanner, frame: str) -> str:
        """What TF says of the scanner in ``frame``, in words, where that is not ``mount``."""
        matrix = self.frames.find(self.base, frame) if frame else None
        if matrix is None:
            return ""
        told = mounted(matrix)
        off = float(np.hypot(told.x - mount.x, told.y - mount.y))
        turned = abs(wrapped(told.yaw - mount.yaw))
        if off <= _MOUNTED[0] and turned <= _MOUNTED[1] and told.upside_down == mount.upside_down:
            return ""
        flipped = ", upside down" if told.upside_down else ""
        return (
            f"TF has the scanner at {told.x:.2f},{told.y:.2f},{np.degrees(told.yaw):.0f}°{flipped}"
        )

    def _take_odometry(self, odometry: Odometry, now: float) -> None:
        wrong = self.wheels.add(odometry)
        if wrong is not None and wrong[0] is Reason.ODOMETRY_JUMPED:
            self._lose(*wrong)
        elif wrong is not None:
            self._faults["odometry"] = wrong
        self._localize()

    def _take_transforms(self, transforms: Transforms, now: float) -> None:
        self.frames.add(transforms)

    def _take_map(self, message: GridMap, now: float) -> None:
        if self._given_map:
            return
        try:
            map_ = RobotMap.of_message(message, self.radius)
        except MapFaultError as error:
            self._faults["map"] = error.reason, error.words
            return
        if self.map is not None and map_.frame != self.map.frame:
            words = f"a map in the frame {map_.frame} came after one in {self.map.frame}"
            self._faults["map"] = Reason.MAP_FRAME, words
        elif not map_.same_as(self.map):
            self._enter(map_)

    def _enter(self, map_: RobotMap) -> None:
        self.map = map_
        self.localization.enter(map_)

    def _take_people(self, people: People, now: float) -> None:
        self._people = seen(people)

    def _take_poses(self, poses: Poses, now: float) -> None:
        followed = self._follower.follow(poses)
        if "people" not in self._last:  # who has velocities is better heard
            self._people = followed

    def _pose_fault(self, pose: StampedPose) -> Fault | None:
        if not np.isfinite(pose.pose).all():
            return Reason.POSE_INVALID, "a pose is not finite"
        if self.map is None or pose.frame in ("", self.map.frame):
            return None
        return (
            Reason.POSE_FRAME,
            f"a pose is in the frame {pose.frame}, the map in {self.map.frame}",
        )

    def _take_robot_pose(self, pose: StampedPose, now: float) -> None:
        wrong = self._pose_fault(pose)
        if wrong is not None:
            self._faults["robot_pose"] = wrong
            return
        self.robot_said = pose
        self.localization.hear(pose, self.wheels)

    def _take_initial_pose(self, pose: StampedPose, now: float) -> None:
        wrong = self._pose_fault(pose)
        if wrong is None and self.map is not None and not self.map.grid.contains(*pose.pose[:2]):
            x, y = pose.pose[:2]
            wrong = Reason.POSE_INVALID, f"the pose ({x:.2f}, {y:.2f}) is not on the map"
        if wrong is not None:
            self._faults["initial_pose"] = wrong
            return
        self.localization.begin(pose.pose, pose.covariance, pose.stamp)

    def _take_goal(self, goal: StampedPose, now: float) -> None:
        self.goal = goal

    def _take_enable(self, content: Switch | Joystick, now: float) -> None:
        if isinstance(content, Switch):
            on = content.on
        else:
            on = self._button < len(content.buttons) and content.buttons[self._button] == 1
        self._enabled_at = now if on else -np.inf

    def _base_in(self, frame: str) -> Floats | None:
        """Where the base (3,) is in ``frame``, at the scan's moment; None where unknown."""
        assert self.estimate is not None
        if frame in ("", self.base):
            return np.zeros(3)
        if self.map is not None and frame == self.map.frame:
            return self.estimate.pose
        if frame == self.wheels.frame:
            at = self.wheels.at(self.estimate.stamp)
            return self.wheels.newest if at is None else at
        found = self.frames.find(frame, self.base)
        return None if found is None else planar(found)
