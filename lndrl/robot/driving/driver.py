"""A robot driven: messages in, commands out, and at any moment a reason where it stands.

Knows no network and no clock of its own, so that a live robot, a stand-in and a recording are
driven by the same code.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.localization import Health
from lndrl.robot.driving.belief import Estimate
from lndrl.robot.driving.guarding import DriveGuard
from lndrl.robot.driving.maps import RobotMap
from lndrl.robot.driving.pilot import Decision, Pilot
from lndrl.robot.driving.reasons import Reason, Stop, in_order
from lndrl.robot.driving.scans import uncovered
from lndrl.robot.driving.senses import Senses
from lndrl.robot.limits import Limits
from lndrl.robot.messages import (
    SECOND,
    Content,
    Poses,
    StampedPose,
    Velocity,
    Words,
)

Floats = NDArray[np.float64]
Send = Callable[[str, Content], None]

_AGAIN = 0.1
"""s after which a command is sent again: bases stop by themselves when none comes."""
_ZEROS = 1.0
"""s for which a stop is sent again; then others may command the robot."""
_STATUS = 1.0
_PARTICLES = 0.5
"""s between two messages."""
_MOST_PARTICLES = 500
_UNSURE = 0.2
"""m/s by which a tracker may be wrong."""


@dataclass
class Tally:
    """What a drive has come to."""

    decisions: int = 0
    guarded: int = 0
    """Decisions that the guard did not let through as they were."""
    arrivals: int = 0
    stops: dict[str, int] = field(default_factory=dict)
    """How often a reason stopped the robot."""
    distance: float = 0.0
    """m, by the odometry."""


@dataclass(frozen=True)
class DriveView:
    """What a drive looks like at one moment, for screens."""

    time: float
    map: RobotMap | None
    estimate: Estimate | None
    goal: Floats | None
    echoes: Floats
    """(n, 2) m, where the scan met something, in the map's frame."""
    people: Floats
    """(n, 4) in the robot's frame."""
    command: tuple[float, float]
    probabilities: NDArray[np.floating] | None
    actions: Floats
    stops: tuple[Stop, ...]
    guard: bool
    """Whether there is one."""
    doubt: str
    """What does not hold of its bounds, or of the robot's file, as far as that is seen."""
    guarded: str
    """What it sees, where it holds back what was decided."""
    unseen: float
    """Share of what the policy looks at where the scanner does not look."""
    robot_radius: float
    arrive_distance: float
    tally: Tally


class Driver:
    """Drives by ``pilot`` with what ``senses`` says. ``send`` is called with what a message is for
    and what it says; ``guard`` looks at every command but a stop, after ``limits``.
    """

    def __init__(
        self,
        pilot: Pilot,
        senses: Senses,
        send: Send,
        limits: Limits | None = None,
        guard: DriveGuard | None = None,
        goal: StampedPose | None = None,
    ) -> None:
        self.pilot, self.senses = pilot, senses
        self.tally = Tally()
        self.decision: Decision | None = None
        self.command = 0.0, 0.0
        self.outside: dict[Reason, str] = {}
        """Reasons that whoever owns the driver knows of: the link, topics, an interruption."""
        self.arrived = False
        self.send, self._limits, self.guard = send, limits or Limits(), guard
        self._goal: Floats | None = None
        self._goal_fault: tuple[Reason, str] | None = None
        self._failed: str | None = None
        self.guarded = ""
        """Why the guard has let something else through than was asked for, in the last command."""
        self._wanted = 0.0, 0.0
        self._due = 0
        self._sent_at = self._stopped_at = self._said_at = self._shown_at = -np.inf
        self._said: tuple[str, ...] = ("",)
        self._stops: tuple[Stop, ...] = ()
        self._last_odometry: Floats | None = None
        senses.goal = goal

    @property
    def stops(self) -> tuple[Stop, ...]:
        """Why it stands, the first to mend at the front; empty while it drives."""
        if not self._stops and self.guarded and self.command == (0.0, 0.0):
            return (Stop(Reason.GUARDED, self.guarded),)
        return self._stops

    def take(
        self,
        purpose: str,
        content: Content,
        now: float,
        clock: int | None,
        came: float | None = None,
    ) -> bool:
        """Take in a message that ``came`` (``now``, unless it had to wait), when ``clock`` showed
        that; see ``Senses.take``. True where it led to a decision.
        """
        goal_before = self.senses.goal
        moved = self.senses.take(purpose, content, now if came is None else came, clock)
        if self.senses.goal is not goal_before:
            self._goal, self._goal_fault, self.arrived = None, None, False
        if purpose == "initial_pose":  # a robot that was carried begins anew
            self._due = 0
        if not moved:
            return False
        decided = self._step(now)
        self._publish(now)
        return decided

    def watch(self, now: float) -> None:
        """Time passes: stop if something has become stale, else say again what holds."""
        self._judge(now)
        if self._stops:
            self._stand(now)
        elif now - self._sent_at >= _AGAIN:
            self._command(self._wanted, now)
        self._status(now)

    def stand(self, now: float, words: str) -> None:
        """Stop for good, at once."""
        self.outside[Reason.INTERRUPTED] = words
        self._judge(now)
        self._stand(now, again=True)
        self._status(now)

    def view(self, now: float) -> DriveView:
        """What there is to see."""
        estimate, scan = self.senses.estimate, self.senses.scan
        echoes = np.zeros((0, 2))
        if estimate is not None and scan is not None:
            hit = np.isfinite(scan.ranges)
            angle = estimate.pose[2] + scan.bearings[hit].astype(np.float64)
            reach = scan.ranges[hit].astype(np.float64)[:, None]
            echoes = estimate.pose[:2] + reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        decision, config = self.decision, self.pilot.config
        return DriveView(
            time=now,
            map=self.senses.map,
            estimate=estimate,
            goal=self._goal,
            echoes=echoes,
            people=np.zeros((0, 4)) if decision is None else decision.people,
            command=self.command,
            probabilities=None if decision is None else decision.probabilities,
            actions=self.pilot.actions,
            stops=self.stops,
            guard=self.guard is not None,
            doubt=self._doubt(),
            guarded=self.guarded,
            unseen=0.0 if scan is None else uncovered(scan, config.world.laser),
            robot_radius=self.senses.radius,
            arrive_distance=config.task.arrive_distance,
            tally=self.tally,
        )

    def _step(self, now: float) -> bool:
        """A new estimate: see to the goal, decide where it is time, command."""
        self._drove()
        self._seek()
        self._judge(now)
        if self._stops:
            self._stand(now)
            return False
        decided = self._is_due()
        if decided:
            self._decide(now)
            self._judge(now)
            if self._stops:
                self._stand(now)
                return True
        self._command(self._wanted, now)
        self.tally.guarded += bool(decided and self.guarded)
        return decided

    def _seek(self) -> None:
        """Take up a goal, and see whether the robot is there."""
        estimate, map_ = self.senses.estimate, self.senses.map
        if estimate is None or map_ is None:
            return
        if self._goal is None and self.senses.goal is not None and not self.arrived:
            found = self.senses.goal_in_map()
            if isinstance(found, tuple):
                self._goal_fault = found
            elif found is not None:
                self._goal_fault = map_.fault_of_goal(found, estimate.pose)
                if self._goal_fault is None:
                    self._goal, self._due = found, 0
                    self._try(lambda: self.pilot.begin(found, estimate.pose, map_))
        if self._goal is not None:
            left = float(np.hypot(*(estimate.pose[:2] - self._goal)))
            if left < self.pilot.config.task.arrive_distance:
                self._goal, self.arrived = None, True
                self.tally.arrivals += 1

    def _is_due(self) -> bool:
        """Whether a control period is over, to within half a scan."""
        assert self.senses.estimate is not None
        stamp = self.senses.estimate.stamp
        period = round(self.pilot.period * SECOND)
        slack = round(0.05 * SECOND)
        if self._due and stamp < self._due - slack and stamp > self._due - 2 * period:
            return False
        late = not self._due or abs(stamp - self._due) >= period // 2
        self._due = (stamp if late else self._due) + period
        return True

    def _decide(self, now: float) -> None:
        scan, estimate = self.senses.scan, self.senses.estimate
        assert scan is not None and estimate is not None

        def decide() -> None:
            self.decision = self.pilot.decide(
                scan, estimate, self.senses.people(), self.senses.wheels.velocity
            )
            self._wanted = self.decision.v, self.decision.w
            if not np.isfinite(self._wanted).all():
                raise ValueError(f"it answers {self._wanted}")

        self._try(decide)
        self.tally.decisions += 1

    def _try(self, work: Callable[[], None]) -> None:
        """What a planner does wrong is a reason to stand, whoever has written it."""
        try:
            work()
        except UserError as error:
            self._failed = str(error)
        except Exception as error:
            said = " ".join(str(error).split())[:200]
            self._failed = f"{self.pilot.planner.name} fails: {type(error).__name__} {said}"

    def _judge(self, now: float) -> None:
        """Gather all reasons that hold now."""
        found = {**self.senses.stops(now), **self.outside}
        if self._failed is not None:
            found[Reason.PLANNER_FAILED] = self._failed
        if self._goal_fault is not None:
            found.setdefault(*self._goal_fault)
        elif self.arrived:
            found[Reason.ARRIVED] = "the robot is at its goal"
        elif self.senses.goal is None:
            found[Reason.NO_GOAL] = "there is no goal"
        before = self._stops
        self._stops = in_order(found)
        for stop in self._stops:
            if not before and self.tally.decisions and not stop.reason.is_rest:
                self._count(stop.reason)
        if self._stops and not before:
            self._stopped_at = now
            self._sent_at = -np.inf

    def _count(self, reason: Reason) -> None:
        self.tally.stops[reason.label] = self.tally.stops.get(reason.label, 0) + 1

    def _stand(self, now: float, again: bool = False) -> None:
        """Send a stop at once, and again for a while."""
        self._wanted, self.guarded = (0.0, 0.0), ""
        moving = self.command != (0.0, 0.0)
        repeat = now - self._stopped_at <= _ZEROS and now - self._sent_at >= _AGAIN
        if moving or repeat or again:
            self._emit(0.0, 0.0, now)

    def _doubt(self) -> str:
        """Who walks faster than the guard counts on, or what TF has otherwise, in words."""
        if self.senses.mount_doubt:
            return self.senses.mount_doubt
        people = None if self.guard is None else self.senses.people()
        if self.guard is None or people is None or not len(people.velocity):
            return ""
        fastest = float(np.hypot(*people.velocity.T).max())
        beyond = fastest > self.guard.parameters.people_speed + _UNSURE
        return f"somebody walks {fastest:.1f} m/s" if beyond else ""

    def _command(self, wanted: tuple[float, float], now: float) -> None:
        seconds = min(now - self._sent_at, 0.5) if np.isfinite(self._sent_at) else _AGAIN
        v, w = self._limits.within(wanted, self.command, seconds)
        if self.guard is not None:
            stood = self.stops
            last = self.command

            def choices() -> Floats:
                each = [self._limits.within((a, b), last, seconds) for a, b in self.pilot.actions]
                return np.array(each)

            scores = None if self.decision is None else self.decision.probabilities
            told = self.guard.check((v, w), last, self.senses, now, choices, scores)
            v, w, self.guarded = told.v, told.w, told.words
            self._emit(v, w, now)
            if self.stops and not stood:
                self._count(Reason.GUARDED)
            return
        self._emit(v, w, now)

    def _emit(self, v: float, w: float, now: float) -> None:
        self.command, self._sent_at = (v, w), now
        estimate = self.senses.estimate
        stamp = 0 if estimate is None else estimate.stamp
        self.send("command", Velocity(v, w, stamp, self.senses.base))

    def _drove(self) -> None:
        here = self.senses.wheels.newest
        if here is not None and self._last_odometry is not None:
            self.tally.distance += float(np.hypot(*(here - self._last_odometry)[:2]))
        self._last_odometry = here

    def _publish(self, now: float) -> None:
        """The belief, for RViz and whoever else wants to know."""
        estimate, map_ = self.senses.estimate, self.senses.map
        if estimate is None or map_ is None:
            return
        frame = map_.frame
        self.send(
            "own_pose", StampedPose(estimate.stamp, frame, estimate.pose, estimate.covariance)
        )
        if now - self._shown_at >= _PARTICLES:
            self._shown_at = now
            stride = -(-len(estimate.particles) // _MOST_PARTICLES)
            self.send("particles", Poses(estimate.stamp, frame, estimate.particles[::stride]))

    def _status(self, now: float) -> None:
        """Say why it stands, when that changes and every second."""
        labels = tuple(stop.reason.label for stop in self.stops)
        if labels == self._said and now - self._said_at < _STATUS:
            return
        self._said, self._said_at = labels, now
        self.send("status", Words(json.dumps(self.status())))

    def status(self) -> dict[str, object]:
        """What is published as text: state, the first reason, all of them, and in words."""
        stops = self.stops
        first = stops[0] if stops else None
        estimate = self.senses.estimate
        health = None if estimate is None else estimate.health
        return {
            "state": "standing" if first else "driving",
            "reason": first.reason.label if first else "",
            "words": str(first) if first else "",
            "all": [stop.reason.label for stop in stops],
            "guard": "off" if self.guard is None else "on",
            "guarded": self.guarded,
            "doubt": self._doubt(),
            "health": None if health is None else _plain(health),
        }


def _plain(health: Health) -> dict[str, float | int | None]:
    """A health report as JSON has it: what is not finite is not known."""
    return {
        name: round(value, 4) if math.isfinite(value) else None
        for name, value in vars(health).items()
    }
