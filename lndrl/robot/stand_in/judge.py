"""How an episode of a rehearsal ends, by the rules of ``lndrl evaluate`` and the truth."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.navigation import Outcome
from lndrl.robot.geometry import wrapped
from lndrl.robot.messages import StampedPose
from lndrl.robot.stand_in.body import Body

_REMEMBERED = 200
"""Ticks; older reports are held against the oldest of them."""


@dataclass(frozen=True)
class DrivenEpisode:
    """An episode as a robot has driven it: s, m, errors (m, rad) as means over control steps.

    ``stood``: whether the robot drove no more when the episode ended; who touches it then has
    walked into it.
    """

    episode: int
    outcome: Outcome
    steps: int
    time: float
    distance: float
    position_error: float
    angle_error: float
    stood: bool

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        return asdict(self)


class Judge:
    """Watches one episode. ``limited``: it ends when it is out of time."""

    def __init__(self, body: Body, episode: int, limited: bool = True) -> None:
        self._body, self._episode, self._limited = body, episode, limited
        self._last = body.pose_true.copy()
        self._distance = self._position = self._angle = 0.0
        self._judged = 0
        self._truth: deque[tuple[int, NDArray[np.float64]]] = deque(maxlen=_REMEMBERED)

    def sensed(self, stamp: int) -> None:
        """Sensors have spoken of this moment, under ``stamp``."""
        self._truth.append((stamp, self._body.pose_true.copy()))

    def moved(self) -> None:
        """A tick has passed."""
        pose = self._body.pose_true
        self._distance += float(np.hypot(*(pose - self._last)[:2]))
        self._last = pose.copy()

    def is_there(self, told: StampedPose) -> bool:
        """Whether who drives believes to be at the goal, and so drives no further."""
        off = told.pose[:2] - self._body.goal
        return float(np.hypot(*off)) < self._body.config.task.arrive_distance

    def verdict(self, told: StampedPose | None, touched: bool) -> Outcome | None:
        """After a control step, or when ``is_there``: whether it is over. ``told`` is what the
        robot believes, in the map frame, held against the truth of the moment that it speaks of;
        None where it has not said.
        """
        task, body = self._body.config.task, self._body
        if touched:
            return "collided"
        if told is not None:
            estimate, truth = told.pose, self._at(told.stamp)
            off = float(np.hypot(*(estimate - truth)[:2]))
            turned = abs(wrapped(float(estimate[2] - truth[2])))
            self._position, self._angle = self._position + off, self._angle + turned
            self._judged += 1
            if off > task.lost_distance or turned > task.lost_angle:
                return "lost"
            if self.is_there(told):
                return "arrived"
        if self._limited and body.steps >= body.steps_limit:
            return "timeout"
        return None

    def _at(self, stamp: int) -> NDArray[np.float64]:
        """The true pose at ``stamp``, or at the nearest moment that is remembered."""
        if not self._truth:
            return self._body.pose_true
        return min(self._truth, key=lambda each: abs(each[0] - stamp))[1]

    def record(self, outcome: Outcome) -> DrivenEpisode:
        """The episode that has ended so."""
        return DrivenEpisode(
            episode=self._episode,
            outcome=outcome,
            steps=self._body.steps,
            time=self._body.world.time,
            distance=self._distance,
            position_error=self._position / self._judged if self._judged else math.nan,
            angle_error=self._angle / self._judged if self._judged else math.nan,
            stood=float(self._body.world.robot.velocity[0]) == 0.0,
        )
