"""People around the robot: from tracks, or from poses that are followed here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.robot.geometry import moved_points, turned_vectors
from lndrl.robot.messages import SECOND, People, Poses

Floats = NDArray[np.float64]

_FASTEST = 2.5
"""m/s; nobody in a crowd is faster, and what seems so is somebody else."""
_LAG = 0.5
"""Share of the newest velocity that a followed pose takes up: differences are noisy."""
_LONGEST = 1.0
"""s between two messages of which the poses are still followed."""


@dataclass(frozen=True)
class Seen:
    """People at one moment: positions (n, 2) m and velocities over the ground (n, 2) m/s, in
    ``frame``."""

    stamp: int
    frame: str
    position: Floats
    velocity: Floats

    def within(self, pose: Floats) -> tuple[Floats, Floats]:
        """The same in the frame in which ``pose`` (3,) of ``frame`` is given."""
        return moved_points(pose, self.position), turned_vectors(pose, self.velocity)


def seen(people: People) -> Seen:
    """Those tracks that are finite."""
    good = np.isfinite(people.position).all(axis=1) & np.isfinite(people.velocity).all(axis=1)
    return Seen(people.stamp, people.frame, people.position[good], people.velocity[good])


class Follower:
    """Gives poses without velocities those that they have moved with.

    Each is the nearest of the message before, if a person can have walked from there.
    """

    def __init__(self) -> None:
        self._last: Seen | None = None

    def follow(self, poses: Poses) -> Seen:
        """The people of ``poses``; who has just appeared stands."""
        position = poses.poses[:, :2]
        position = position[np.isfinite(position).all(axis=1)]
        velocity = np.zeros_like(position)
        last = self._last
        if last is not None and last.frame == poses.frame:
            if poses.stamp <= last.stamp:
                return last
            seconds = (poses.stamp - last.stamp) / SECOND
            if seconds <= _LONGEST:
                velocity = _velocities(last, position, seconds)
        self._last = Seen(poses.stamp, poses.frame, position, velocity)
        return self._last


def _velocities(last: Seen, position: Floats, seconds: float) -> Floats:
    """Of people now at ``position``, who were among ``last`` so many ``seconds`` ago."""
    velocity = np.zeros_like(position)
    if not len(position) or not len(last.position):
        return velocity
    expected = last.position + seconds * last.velocity
    away = np.linalg.norm(position[:, None] - expected[None], axis=2)
    for _ in range(min(away.shape)):  # the nearest pair first; nobody is two
        i, j = np.unravel_index(int(away.argmin()), away.shape)
        step = (position[i] - last.position[j]) / seconds
        if not np.isfinite(away[i, j]):
            break
        if np.hypot(*step) <= _FASTEST:
            velocity[i] = last.velocity[j] + _LAG * (step - last.velocity[j])
            away[i, :] = away[:, j] = np.inf
        else:
            away[i, j] = np.inf
    return velocity
