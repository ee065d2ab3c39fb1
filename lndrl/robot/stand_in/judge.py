"""How an episode of a rehearsal ends, by the rules of ``lndrl evaluate`` and the truth."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.navigation import Outcome
from lndrl.robot.geometry import wrapped
from lndrl.robot.stand_in.body import Body


@dataclass(frozen=True)
class DrivenEpisode:
    """An episode as a robot has driven it: s, m, errors (m, rad) as means over control steps."""

    episode: int
    outcome: Outcome
    steps: int
    time: float
    distance: float
    position_error: float
    angle_error: float

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

    def moved(self) -> None:
        """A tick has passed."""
        pose = self._body.pose_true
        self._distance += float(np.hypot(*(pose - self._last)[:2]))
        self._last = pose.copy()

    def verdict(self, estimate: NDArray[np.float64] | None, touched: bool) -> Outcome | None:
        """After a control step: whether it is over. ``estimate`` (3,) in the map frame is what the
        robot believes, None where it has not said so.
        """
        task, body = self._body.config.task, self._body
        if touched:
            return "collided"
        if estimate is not None:
            off = float(np.hypot(*(estimate - body.pose_true)[:2]))
            turned = abs(wrapped(float(estimate[2] - body.pose_true[2])))
            self._position, self._angle = self._position + off, self._angle + turned
            self._judged += 1
            if off > task.lost_distance or turned > task.lost_angle:
                return "lost"
            if float(np.hypot(*(estimate[:2] - body.goal))) < task.arrive_distance:
                return "arrived"
        if self._limited and body.steps >= body.steps_limit:
            return "timeout"
        return None

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
        )
