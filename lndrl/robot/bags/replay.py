"""A recording driven through once more: where the belief goes, what the policy would have done.

Nothing moves by it: commands are noted beside those that were recorded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.robot.bags.reader import Bag, Recorded
from lndrl.robot.driving import Driver, Reason, RobotMap
from lndrl.robot.geometry import interpolated, wrapped
from lndrl.robot.messages import SECOND, Clock, Content, Odometry, StampedPose, Velocity

Floats = NDArray[np.float64]

_WATCHED_EVERY = 0.1
"""s of the recording between two looks at what has become stale."""
_LONGEST_GAP = 5.0
"""s of silence that are looked at; what is stale for longer is no more so."""
_NEAR = 0.25
"""s within which a reference belongs to a belief."""
_SAME = 0.05
"""m/s and rad/s within which two commands are the same."""


@dataclass(frozen=True)
class Moment:
    """The belief after one scan: ``time`` in s from the first message; NaN for what is not known.

    ``off`` (m) and ``turned`` (rad): from the reference. ``command``: what the policy asks for,
    ``recorded``: what was last sent when this was recorded; (v, w).
    """

    time: float
    pose: Floats
    deviation: float
    deviation_yaw: float
    agreement: float
    effective: float
    off: float
    turned: float
    command: tuple[float, float] | None
    recorded: tuple[float, float] | None
    reasons: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain types, for CSV and JSON."""
        v, w = self.command or (None, None)
        v_recorded, w_recorded = self.recorded or (None, None)
        x, y, yaw = self.pose.tolist()
        return {
            "time": self.time, "x": x, "y": y, "yaw": yaw, "deviation": self.deviation,
            "deviation_yaw": self.deviation_yaw, "agreement": self.agreement,
            "effective": self.effective, "off": self.off, "turned": self.turned, "v": v, "w": w,
            "v_recorded": v_recorded, "w_recorded": w_recorded, "reasons": " ".join(self.reasons),
        }  # fmt: skip


@dataclass
class Replay:
    """What a replay has found. ``standing``: s for which each reason came first."""

    seconds: float
    scans: int = 0
    moments: list[Moment] = field(default_factory=list)
    standing: dict[str, float] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)
    """Of each reason that ever held: what was seen first."""
    decisions: int = 0
    guarded: int = 0
    """Decisions that the guard would not have let through as they were."""
    arrivals: int = 0
    map: RobotMap | None = None
    reference: Floats = field(default_factory=lambda: np.zeros((0, 4)))
    """(n, 4) s, x, y, yaw of what was compared with."""
    reference_topic: str = ""
    goal: Floats | None = None

    def column(self, name: str) -> Floats:
        """One number of all moments, e.g. ``off``."""
        return np.array([getattr(each, name) for each in self.moments], np.float64)

    @property
    def same_commands(self) -> float:
        """Share of moments with both commands at which they are the same; NaN without any."""
        pairs = [
            (each.command, each.recorded)
            for each in self.moments
            if each.command is not None and each.recorded is not None
        ]
        if not pairs:
            return float("nan")
        off = np.abs(np.array(pairs)[:, 0] - np.array(pairs)[:, 1])
        return float((off <= _SAME).all(axis=1).mean())

    def summary(self) -> dict[str, Any]:
        """The figures of the table, in plain types; None for what is not known."""

        def of(name: str, how: Callable[[Floats], Any]) -> float | None:
            values = self.column(name)
            values = values[np.isfinite(values)]
            return float(how(values)) if len(values) else None

        def most(values: Floats) -> Any:
            return np.percentile(values, 95)

        same = self.same_commands
        return {
            "seconds": self.seconds,
            "scans": self.scans,
            "beliefs": len(self.moments),
            "deviation_mean": of("deviation", np.mean),
            "deviation_p95": of("deviation", most),
            "agreement_mean": of("agreement", np.mean),
            "effective_median": of("effective", np.median),
            "reference": self.reference_topic or None,
            "off_mean": of("off", np.mean),
            "off_p95": of("off", most),
            "off_end": self.moments[-1].off if self.moments and self.reference_topic else None,
            "turned_mean": of("turned", np.mean),
            "decisions": self.decisions,
            "guarded": self.guarded / self.decisions if self.decisions else None,
            "arrivals": self.arrivals,
            "same_commands": None if np.isnan(same) else same,
            "standing": dict(sorted(self.standing.items(), key=lambda each: -each[1])),
        }


def replay(
    bag: Bag,
    make: Callable[[Callable[[str, Content], None]], Driver],
    progress: Callable[[float], None] | None = None,
) -> Replay:
    """Drive through ``bag`` with what ``make`` makes of a way to send; ``progress`` hears of the s
    that are done.
    """
    return _Player(bag, make).play(progress)


class _Player:
    """Feeds a driver from a bag, and writes down what comes of it."""

    def __init__(self, bag: Bag, make: Callable[[Callable[[str, Content], None]], Driver]) -> None:
        self._bag = bag
        self._driver = make(lambda purpose, content: None)
        self._result = Replay(bag.seconds)
        self._first: int | None = None
        self._clock: int | None = None
        self._now = self._watched = 0.0
        self._recorded: tuple[float, float] | None = None
        self._references: dict[str, list[tuple[int, Floats]]] = {}
        self._stamps: list[int] = []

    def play(self, progress: Callable[[float], None] | None) -> Replay:
        for message in self._bag.messages():
            if self._first is None:
                self._first = message.stamp
                self._now = self._watched = self._time(message)
            self._pass(message)
            self._take(message)
            if progress is not None:
                progress((message.stamp - self._first) / SECOND)
        result, driver = self._result, self._driver
        goal = driver.senses.goal_in_map()
        result.map, result.goal = driver.senses.map, None if isinstance(goal, tuple) else goal
        result.decisions, result.arrivals = driver.tally.decisions, driver.tally.arrivals
        result.guarded = driver.tally.guarded
        self._compare()
        return result

    def _time(self, message: Recorded) -> float:
        """s of the recording: a simulation's, or when it was written."""
        if self._bag.simulated:
            return 0.0 if self._clock is None else self._clock / SECOND
        return message.stamp / SECOND

    def _pass(self, message: Recorded) -> None:
        """Let time pass until ``message``, and see what becomes stale meanwhile."""
        now = self._time(message)
        if now - self._now > _LONGEST_GAP or now < self._now:
            self._watched = now
        self._now = now
        while now - self._watched >= _WATCHED_EVERY:
            self._watched += _WATCHED_EVERY
            self._driver.watch(self._watched)
            if stops := self._driver.stops:
                label = stops[0].reason.label
                stood = self._result.standing.get(label, 0.0)
                self._result.standing[label] = stood + _WATCHED_EVERY
            for stop in stops:
                self._result.words.setdefault(stop.reason.label, stop.words)

    def _take(self, message: Recorded) -> None:
        content, purpose = message.content, message.purpose
        if content is None:
            self._driver.senses.unreadable(purpose, Reason.UNREADABLE, message.words, self._now)
        elif isinstance(content, Clock):
            self._clock = content.stamp
        elif isinstance(content, Velocity):
            self._recorded = content.v, content.w
        elif purpose in ("reference", "own_pose"):
            self._refer(purpose, content)
        else:
            if purpose == "robot_pose":
                self._refer(purpose, content)
            clock = self._clock if self._bag.simulated else message.stamp
            before = self._driver.senses.estimate
            self._driver.take(purpose, content, self._now, clock)
            self._result.scans += purpose == "scan"
            if self._driver.senses.estimate is not before:
                self._note()

    def _refer(self, kind: str, content: Content) -> None:
        if isinstance(content, StampedPose | Odometry) and np.isfinite(content.pose).all():
            self._references.setdefault(kind, []).append((content.stamp, content.pose))

    def _note(self) -> None:
        """Write down the belief that a scan has led to."""
        estimate = self._driver.senses.estimate
        if estimate is None:
            return
        x, y, yaw = np.sqrt(np.maximum(estimate.variance, 0.0))
        stops = tuple(stop.reason.label for stop in self._driver.stops)
        stands = bool(stops) and not self._driver.guarded  # the guard's standing is a command
        self._stamps.append(estimate.stamp)
        self._result.moments.append(
            Moment(
                (estimate.stamp - self._stamps[0]) / SECOND, estimate.pose, float(np.hypot(x, y)),
                float(yaw), estimate.agreement, estimate.effective, np.nan, np.nan,
                None if stands else self._driver.command, self._recorded, stops,
            )
        )  # fmt: skip

    def _compare(self) -> None:
        """Hold the beliefs against what is known best: what was asked for, then the robot's own."""
        for kind in ("reference", "robot_pose", "own_pose"):
            if found := self._references.get(kind):
                break
        else:
            return
        result = self._result
        result.reference_topic = self._bag.name_of(kind)
        stamps = np.array([stamp for stamp, _ in found])
        order = np.argsort(stamps, kind="stable")
        stamps, poses = stamps[order], np.array([pose for _, pose in found])[order]
        if self._stamps:
            times = (stamps - self._stamps[0]) / SECOND
            result.reference = np.column_stack([times, poses])
        for i, stamp in enumerate(self._stamps):
            pose = _at(stamps, poses, stamp)
            if pose is None:
                continue
            each = result.moments[i]
            off = float(np.hypot(*(each.pose - pose)[:2]))
            turned = abs(wrapped(float(each.pose[2] - pose[2])))
            result.moments[i] = Moment(**{**vars(each), "off": off, "turned": turned})


def _at(stamps: NDArray[np.int64], poses: Floats, stamp: int) -> Floats | None:
    """The reference at ``stamp``; None where there is none near."""
    after = int(np.searchsorted(stamps, stamp))
    near = _NEAR * SECOND
    if after < len(stamps) and stamps[after] == stamp:
        return poses[after]
    if 0 < after < len(stamps) and stamps[after] - stamps[after - 1] <= 2 * near:
        share = (stamp - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
        return interpolated(poses[after - 1], poses[after], float(share))
    nearest = min(max(after, 0), len(stamps) - 1)
    if after > 0 and (after == len(stamps) or stamp - stamps[after - 1] < stamps[nearest] - stamp):
        nearest = after - 1
    return poses[nearest] if abs(int(stamps[nearest]) - stamp) <= near else None
