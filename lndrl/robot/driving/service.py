"""A live drive: one loop between a robot's link and the driver, which must never wait long.

Whatever ends it, the last that goes out is a stop.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from queue import Empty

import zenoh

from lndrl.robot.driving.driver import Driver, DriveView
from lndrl.robot.driving.reasons import Reason
from lndrl.robot.link import Arrival, Link, Publisher, Topic
from lndrl.robot.messages import SECOND, BadMessageError, Clock, Content, Velocity, names
from lndrl.robot.recording import Recorder
from lndrl.robot.topics import Topics

WATCH_EVERY = 0.02
"""s between two looks at what has become stale."""
_LINK_EVERY, _TYPES_EVERY, _SHOWN_EVERY = 0.2, 1.0, 0.25
_CLOCK_STOPPED = 1.5
"""s of ours without a tick of a simulation's clock; one that waits for us takes up to a second."""
_LAST_STOPS = 5
_COMMANDS = (names.TWIST, names.TWIST_STAMPED)


@dataclass(frozen=True)
class Wanted:
    """What is listened to: ``own_map`` needs none from the robot; ``people`` may be left out;
    ``enable`` is a deadman's topic; ``simulated`` time comes from a clock that is published.
    """

    topics: Topics
    own_map: bool = False
    robot_pose: bool = True
    people: bool = True
    enable: Topic | None = None
    simulated: bool = False
    awaits_clock: bool = False
    """Whether time becomes simulated where a clock is published later."""
    stamped: bool = False
    """Whether commands are TwistStamped until the robot says itself which it listens to."""


class DriveService:
    """``driver`` is made by ``make`` from what sends for it."""

    def __init__(
        self,
        link: Link,
        make: Callable[[Callable[[str, Content], None]], Driver],
        wanted: Wanted,
        recorder: Recorder | None = None,
    ) -> None:
        self.wanted = wanted
        self.latencies: deque[float] = deque(maxlen=100_000)
        """s from a scan's arrival to the command that was decided on it, for each decision."""
        self._link, self._recorder = link, recorder
        self._publishers: dict[tuple[str, str], Publisher] = {}
        self._command_types = {names.TWIST_STAMPED if wanted.stamped else names.TWIST}
        self._purposes: dict[Topic, str] = {}
        self._clock: int | None = None
        self._ticked = time.monotonic()
        self._past = 0.0  # s that simulated time has gone back by, in all
        self._looked = self._linked = self._typed = self._shown = 0.0
        self.driver = make(self._send)
        self._choose_command_type()
        for purpose in ("own_pose", "particles", "status"):
            self._publisher(purpose)
        self._subscribe()

    def run(
        self,
        stop: threading.Event,
        show: Callable[[DriveView], None] | None = None,
        over: Callable[[], bool] | None = None,
    ) -> None:
        """Drive until ``stop`` is set, or ``over`` says so; ``show`` is called now and then."""
        try:
            while not stop.is_set() and not (over is not None and over()):
                self._work()
                if show is not None and time.monotonic() - self._shown >= _SHOWN_EVERY:
                    self._shown = time.monotonic()
                    show(self.driver.view(self._now()))
        finally:
            self._end()

    def _work(self) -> None:
        """Take in what has come, or wait a moment for something."""
        until = time.monotonic() + WATCH_EVERY
        try:
            while True:
                self._take(self._link.inbox.get(timeout=max(until - time.monotonic(), 0.0)))
                if time.monotonic() >= until:
                    break
        except Empty:
            pass
        self._look()
        self.driver.watch(self._now())

    def _take(self, arrival: Arrival) -> None:
        purpose = self._purposes[arrival.topic]
        if self._recorder is not None:
            self._recorder.write(arrival.topic, arrival.data, arrival.received)
        now, said = self._now(), self._link.dialect.hash_in(arrival.key)
        if said and said != self._link.store.type_hash(arrival.topic.type):
            words = f"{arrival.topic.name} comes with the type hash {said[:20]}"
            distribution = self._link.store.distribution
            self.driver.senses.unreadable(
                purpose, Reason.WRONG_DISTRIBUTION, f"{words}, which is not {distribution}'s", now
            )
            return
        try:
            content = self._link.store.decode(arrival.topic.type, arrival.data)
        except BadMessageError as error:
            words = f"{arrival.topic.name} carries {error}"
            self.driver.senses.unreadable(purpose, Reason.UNREADABLE, words, now)
            return
        if isinstance(content, Clock):
            self._tick(content.stamp)
            return
        # A message that had to wait here is as old as if it had waited anywhere else.
        clock: int | None = arrival.received
        came = arrival.at
        if self.wanted.simulated:
            clock, came = self._clock, now
        if self.driver.take(purpose, content, now, clock, came) and purpose == "scan":
            self.latencies.append(time.monotonic() - arrival.at)

    def _tick(self, stamp: int) -> None:
        if self._clock is None:
            self._past -= stamp / SECOND if self._past else 0.0  # time goes on as it was
        if self._clock is not None and stamp < self._clock - SECOND:
            self._past += (self._clock - stamp) / SECOND
        self._clock, self._ticked = stamp, time.monotonic()

    def _now(self) -> float:
        """s of a clock that never goes back: the simulation's, or ours."""
        if not self.wanted.simulated:
            return time.monotonic()
        return self._past if self._clock is None else self._clock / SECOND + self._past

    def _look(self) -> None:
        """See whether the link, the clock and the topics are what they should be."""
        now, outside = time.monotonic(), self.driver.outside
        if self.wanted.simulated:
            _set(
                outside, Reason.CLOCK_STOPPED, now - self._ticked > _CLOCK_STOPPED,
                f"{self.wanted.topics.clock} says nothing",
            )  # fmt: skip
        if now - self._linked >= _LINK_EVERY:
            self._linked = now
            _set(outside, Reason.LINK_LOST, not self._link.connected(), "the link is cut")
        if now - self._typed >= _TYPES_EVERY:
            self._typed = now
            wrong = self._wrong_types()
            _set(outside, Reason.WRONG_TYPE, bool(wrong), wrong)
            self._choose_command_type()
            self._look_for_clock()

    def _look_for_clock(self) -> None:
        """Go by a clock that is published only now, or was only now heard of."""
        clock = self.wanted.topics.topic("clock")
        there = any(
            each.kind == "publisher" and each.topic == clock.name for each in self._link.endpoints()
        )
        if self.wanted.awaits_clock and not self.wanted.simulated and there:
            self._past, self._ticked = time.monotonic(), time.monotonic()
            self.wanted = replace(self.wanted, simulated=True)
            self._purposes[clock] = "clock"
            self._link.subscribe(clock)

    def _wrong_types(self) -> str:
        """The first topic that is published, but by nobody as it is listened to, in words."""
        endpoints = self._link.endpoints()
        for topic in self._purposes:
            types = {
                each.type
                for each in endpoints
                if each.kind == "publisher" and each.topic == topic.name
            }
            if types and topic.type not in types:
                return f"{topic.name} carries {', '.join(sorted(types))}, not {topic.type}"
        command = self.wanted.topics.command
        types = {e.type for e in endpoints if e.kind == "subscriber" and e.topic == command}
        if types and not types & set(_COMMANDS):
            return f"{command} is heard as {', '.join(sorted(types))}, not {_COMMANDS[0]}"
        return ""

    def _choose_command_type(self) -> None:
        """Command in the types that the robot listens to."""
        command = self.wanted.topics.command
        heard = {
            each.type
            for each in self._link.endpoints()
            if each.kind == "subscriber" and each.topic == command
        }
        self._command_types = heard & set(_COMMANDS) or self._command_types
        for each in self._command_types:
            self._publisher("command", each)

    def _subscribe(self) -> None:
        wanted, topics = self.wanted, self.wanted.topics
        # First who can only be heard once, last what everything else is needed for.
        purposes = ["tf_static", "tf", "odometry", "initial_pose", "goal"]
        purposes += [] if wanted.own_map else ["map"]
        purposes += ["people", "people_poses"] if wanted.people else []
        purposes += ["robot_pose"] if wanted.robot_pose else []
        purposes += ["clock"] if wanted.simulated else []
        found = {topics.topic(purpose): purpose for purpose in purposes}
        if wanted.enable is not None:
            found[wanted.enable] = "enable"
        found[topics.topic("scan")] = "scan"
        self._purposes = found
        for topic in found:
            self._link.subscribe(topic)

    def _send(self, purpose: str, content: Content) -> None:
        if purpose == "command":
            publishers = [self._publisher(purpose, each) for each in self._command_types]
        else:
            publishers = [self._publisher(purpose)]
        for publisher in publishers:
            try:
                data = publisher.put(content)
            except zenoh.ZError:  # closed from outside; the loop's end is near
                self.driver.outside[Reason.LINK_LOST] = "the session is closed"
                return
            if self._recorder is not None:
                self._recorder.write(publisher.topic, data, time.time_ns())

    def _publisher(self, purpose: str, type_: str | None = None) -> Publisher:
        topic = self.wanted.topics.topic(purpose, type_)
        key = topic.name, topic.type
        if key not in self._publishers:
            urgent = purpose in ("command", "own_pose")
            self._publishers[key] = self._link.publisher(topic, urgent=urgent)
        return self._publishers[key]

    def _end(self) -> None:
        """Stop the robot, more than once: a message may be lost."""
        self.driver.stand(self._now(), "the drive was ended here")
        for _ in range(_LAST_STOPS - 1):
            time.sleep(0.02)
            self._send("command", Velocity(0.0, 0.0, self._clock or time.time_ns()))


def _set(reasons: dict[Reason, str], reason: Reason, holds: bool, words: str) -> None:
    if holds:
        reasons[reason] = words
    else:
        reasons.pop(reason, None)
