"""Where a robot was after every control step of an episode, and what follows from that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.navigation import EpisodeRecord, Navigation
from lndrl.navigation.families import episode_of

Floats = NDArray[np.float64]

WAITING = 0.05
"""m/s; a robot that is slower over a control step waits."""


@dataclass(frozen=True, eq=False)
class Course:
    """One episode of T control steps of ``seconds`` each; ``poses`` (T + 1, 3) are true (m, rad).

    Not what was commanded but what came of it, wheels that slip included.
    """

    episode: int
    outcome: str
    poses: Floats
    seconds: float

    @property
    def steps(self) -> int:
        """Control steps."""
        return len(self.poses) - 1

    @property
    def places(self) -> Floats:
        """Where each step began (T, 2), m."""
        places: Floats = self.poses[:-1, :2]
        return places

    @property
    def turned(self) -> Floats:
        """How far the robot turned in each step (T,), rad, left and right alike."""
        turn = np.diff(self.poses[:, 2])
        turned: Floats = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
        return turned

    @property
    def moved(self) -> Floats:
        """How far it came in each step (T,), m."""
        moved: Floats = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        return moved

    @property
    def waited(self) -> NDArray[np.bool_]:
        """Whether it waited in each step (T,)."""
        waited: NDArray[np.bool_] = self.moved < WAITING * self.seconds
        return waited


class Watcher:
    """Watches worlds; an ``EpisodeRunner`` takes it as ``watch``. Looks and changes nothing."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._poses: dict[int, list[Floats]] = {}

    def __call__(self, world: Navigation) -> None:
        """Note where the robot of ``world`` is."""
        self._poses.setdefault(world.world_id, []).append(world.world.pose_true.copy())

    def course(self, record: EpisodeRecord) -> Course:
        """The episode that has ended with ``record``; it is forgotten here."""
        poses = np.array(self._poses.pop(record.world))
        return Course(episode_of(record.world), record.outcome, poses, self._seconds)
