"""A robot that is not there: publishes a world as a ROS 2 robot would, and obeys cmd_vel.

It knows no more of who drives it than a robot would: commands come when they come, and when none
came for ``command_timeout`` it stops by itself.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from queue import Empty
from typing import Literal

import numpy as np

from lndrl.errors import UserError
from lndrl.robot.link import Arrival, Link, Publisher
from lndrl.robot.messages import (
    SECOND,
    BadMessageError,
    Clock,
    Content,
    StampedPose,
    Velocity,
    names,
)
from lndrl.robot.stand_in.body import Body
from lndrl.robot.stand_in.conditions import Conditions, Outbox
from lndrl.robot.stand_in.judge import DrivenEpisode, Judge
from lndrl.robot.topics import Topics

FIRST_STAMP = 100 * SECOND
"""ns of simulated time at the start; 0 stands for no time in ROS."""
_ANNOUNCED_EVERY = 1.0
"""s between two tellings of start and goal until somebody drives."""
_LISTENS = 0.1
"""s for which it hears nothing but messages."""
_NEAR = 1.0
"""m from the start within which a driver has taken up what it was told."""

Alter = Callable[[str, Content], Content | None]


@dataclass(frozen=True)
class Rehearsal:
    """How the world goes on. Raises UserError for what cannot be.

    ``episodes``: None until it is stopped. ``pace``: seconds of the world in a second; None: as
    fast as commands come, which needs ``simulated`` time: stamps from a clock that is published.
    """

    episodes: int | None = None
    pace: float | None = 1.0
    simulated: bool = False
    goals: bool = True
    """Tell start and goal; else only the start, and nothing is ever out of time."""
    people: Literal["spencer", "poses", "none"] = "spencer"
    stamped: bool = False
    """Commands are TwistStamped."""
    command_timeout: float = 0.5
    patience: float = 1.0
    """s that a world without a pace waits for a command."""
    conditions: Conditions = field(default_factory=Conditions)

    def __post_init__(self) -> None:
        if self.pace is None and not self.simulated:
            raise UserError("without a pace, time must be simulated")
        if self.pace is not None and not 0.01 <= self.pace <= 1000.0:
            raise UserError(f"pace {self.pace:g}: must be 0.01 to 1000")
        if self.episodes is not None and self.episodes < 1:
            raise UserError(f"episodes {self.episodes}: must be 1 or more")
        if not 0.05 <= self.command_timeout <= 60.0:
            raise UserError(f"command_timeout {self.command_timeout:g}: must be 0.05 to 60 s")


class StandIn:
    """One robot on ``link``. ``alter`` may change or swallow what its sensors say."""

    def __init__(
        self,
        link: Link,
        body: Body,
        rehearsal: Rehearsal,
        topics: Topics | None = None,
        alter: Alter | None = None,
    ) -> None:
        self.body, self.rehearsal = body, rehearsal
        self._link, self._alter = link, alter
        self._topics = topics or Topics()
        self._tick = float(body.config.world.tick)
        self._outbox = Outbox(rehearsal.conditions, body.config.seed)
        self._publishers: dict[str, Publisher] = {}
        self._ticks = 0  # of the rehearsal
        self._began = time.monotonic()
        self._command = Velocity(0.0, 0.0)
        self._commanded = -np.inf  # s of the rehearsal
        self._moved = False  # whether anybody has told it to, in this episode
        self._estimate: StampedPose | None = None
        self._there: StampedPose | None = None  # the estimate of this episode that is at the goal
        self._judge: Judge | None = None
        self._since = 0  # stamp of this episode's beginning
        self._tells_poses = False  # whether who drives says where it believes to be
        self._answered = threading.Event()  # a command or a pose since the last scan
        self._scan_stamp = 0
        kind = names.TWIST_STAMPED if rehearsal.stamped else names.TWIST
        link.subscribe(self._topics.topic("command", kind))
        link.subscribe(self._topics.topic("own_pose"))
        for purpose in self._purposes():  # announced before anybody looks for them
            self._publisher(purpose)

    def run(
        self, stop: threading.Event, told: Callable[[DrivenEpisode], None] | None = None
    ) -> list[DrivenEpisode]:
        """Play the episodes until ``stop`` is set; ``told`` hears of each that has ended."""
        records: list[DrivenEpisode] = []
        self._began = time.monotonic()
        self._send("tf_static", self.body.mounting(self._stamp()))
        while not stop.is_set() and len(records) != self.rehearsal.episodes:
            first = not self._ticks
            if self.body.begin(len(records)) or first:
                self._send("map", self.body.map(self._stamp()))
            record = self._episode(len(records), stop)
            if record is None:
                break
            records.append(record)
            if told is not None:
                told(record)
        return records

    def _purposes(self) -> list[str]:
        """What it publishes."""
        rehearsal = self.rehearsal
        found = ["map", "tf_static", "tf", "odometry", "scan", "initial_pose"]
        found += ["clock"] if rehearsal.simulated else []
        found += ["goal"] if rehearsal.goals else []
        found += ["robot_pose"] if self.body.own_pose(0) is not None else []
        people = {"spencer": "people", "poses": "people_poses", "none": ""}[rehearsal.people]
        return [*found, people] if people else found

    def _episode(self, number: int, stop: threading.Event) -> DrivenEpisode | None:
        """One episode; None where it was stopped."""
        self._judge = judge = Judge(self.body, number, self.rehearsal.goals)
        self._estimate, self._there, self._since, started = None, None, self._stamp(), False
        self._command, announced = Velocity(0.0, 0.0), -np.inf
        self._moved = False
        touched = False
        while not stop.is_set():
            if not self._moved and time.monotonic() - announced > _ANNOUNCED_EVERY:
                announced = time.monotonic()
                if not started:
                    self._send("initial_pose", self.body.initial_pose(self._stamp()))
                if self.rehearsal.goals:  # again until it is heard: who localizes may be deaf yet
                    self._send("goal", self.body.goal_pose(self._stamp()))
            judge.sensed(self._sense())
            self._wait(stop, started)
            if not started:  # the world stands still until somebody drives
                started = self._driven()
                self._ticks += not started
                if not started:
                    continue
            elif self.body.between_steps or touched or self._there is not None:
                # Who believes to be there stands, and may believe something else a moment later.
                outcome = judge.verdict(self._there or self._estimate, touched)
                if outcome is not None:
                    return judge.record(outcome)
            touched = self.body.tick(*self._obeyed())
            judge.moved()
            self._ticks += 1
        return None

    def _driven(self) -> bool:
        """Whether somebody has taken up this episode."""
        told = self._estimate
        if not self._tells_poses:
            return self._command.v != 0.0 or self._command.w != 0.0
        if told is None:
            return False
        near = np.hypot(*(told.pose - self.body.start)[:2]) < _NEAR
        return bool(near) and told.stamp >= self._since

    def _obeyed(self) -> tuple[float, float]:
        """The command of this tick: none that is older than the robot's own timeout."""
        if self._time() - self._commanded > self.rehearsal.command_timeout:
            return 0.0, 0.0
        return self._command.v, self._command.w

    def _sense(self) -> int:
        """Let all sensors speak of this moment; returns the stamp that they speak under."""
        body, stamp, time_ = self.body, self._stamp(), self._time()
        if self.rehearsal.simulated:
            self._send("clock", Clock(stamp))
        said: list[tuple[str, Content]] = [
            ("odometry", body.odometry(stamp)),
            ("tf", body.transforms(stamp)),
        ]
        if self.rehearsal.people == "spencer":
            said.append(("people", body.people(stamp)))
        elif self.rehearsal.people == "poses":
            said.append(("people_poses", body.people_poses(stamp)))
        scan = body.scan(stamp)
        if (pose := body.own_pose(stamp)) is not None:
            said.append(("robot_pose", pose))
        for purpose, content in (*said, ("scan", scan)):
            self._outbox.add(purpose, content, time_)
        self._flush()
        return stamp + round(self.rehearsal.conditions.clock_offset * SECOND)

    def _flush(self) -> None:
        """Send what is due."""
        for purpose, content in self._outbox.due(self._time()):
            if purpose == "scan":
                self._scan_stamp = content.stamp  # type: ignore[union-attr]
                self._answered.clear()
            self._send(purpose, content)

    def _wait(self, stop: threading.Event, started: bool) -> None:
        """Until the next tick: by the clock, or until the last scan is answered."""
        pace = self.rehearsal.pace
        if pace is None:
            # While nobody drives it is as if time had a pace, or it would be told for nothing.
            until = time.monotonic() + (self.rehearsal.patience if started else self._tick)
            while not self._answered.is_set() and not stop.is_set():
                left = until - time.monotonic()
                if left <= 0.0:
                    break
                self._hear(min(left, _LISTENS))  # a little at a time: it may be told to stop
            return
        until = self._began + (self._ticks + 1) * self._tick / pace
        if until < time.monotonic() - 1.0:  # too slow for this pace: no catching up in a rush
            self._began += time.monotonic() - until
        while not stop.is_set():
            self._hear(min(until - time.monotonic(), 0.02))
            self._flush()
            if time.monotonic() >= until:
                return

    def _hear(self, seconds: float) -> bool:
        """Take in one message, within ``seconds``; whether there was one."""
        try:
            arrival = self._link.inbox.get(timeout=max(seconds, 0.0))
        except Empty:
            return False
        self._take(arrival)
        return True

    def _take(self, arrival: Arrival) -> None:
        try:
            content = self._link.store.decode(arrival.topic.type, arrival.data)
        except BadMessageError:
            return
        if isinstance(content, Velocity) and np.isfinite([content.v, content.w]).all():
            self._command, self._commanded = content, self._time()
            self._moved = self._moved or content.v != 0.0 or content.w != 0.0
            if not self._tells_poses:
                self._answered.set()
        elif isinstance(content, StampedPose):
            self._estimate, self._tells_poses = content, True
            if self._there is None and content.stamp >= self._since:
                self._there = content if self._judge and self._judge.is_there(content) else None
            if content.stamp >= self._scan_stamp:
                self._answered.set()

    def _send(self, purpose: str, content: Content) -> None:
        if self._alter is not None:
            altered = self._alter(purpose, content)
            if altered is None:
                return
            content = altered
        self._publisher(purpose).put(content)

    def _publisher(self, purpose: str) -> Publisher:
        if purpose not in self._publishers:
            topic = self._topics.topic(purpose)
            self._publishers[purpose] = self._link.publisher(topic, urgent=purpose == "scan")
        return self._publishers[purpose]

    def _time(self) -> float:
        """s of the rehearsal; between two ticks by the clock on the wall, where it has a pace."""
        if self.rehearsal.pace is None:
            return self._ticks * self._tick
        return (time.monotonic() - self._began) * self.rehearsal.pace

    def _stamp(self) -> int:
        """ns now, as the robot's clock has it."""
        if not self.rehearsal.simulated:
            return time.time_ns()
        return FIRST_STAMP + round(self._ticks * self._tick * SECOND)
