"""What every planner offers: velocities for observations, many episodes at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lndrl.navigation import Observation
from lndrl.randomness import Stream

if TYPE_CHECKING:
    from lndrl.world import Place


class Planner(Protocol):
    """Turns observations into velocities; sees nothing but the observation.

    A planner drives several episodes side by side. Everything random about an episode comes from
    its own generator, so it does the same whatever runs beside it.
    """

    name: str

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """Start episodes in the worlds with these ids, one row each, of the run ``seed``."""

    def act(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Velocities for the next control step.

        ``observation`` (B,) holds the episodes at ``rows`` (B,) of the last ``reset``; finished
        ones are left out. Returns (B, 2): v (m/s), w (rad/s).
        """


@runtime_checkable
class MapPlanner(Planner, Protocol):
    """A planner that also knows the map, and where in it the robot believes to be.

    Whoever drives it calls ``enter`` after each ``reset`` and ``hear`` before each ``act``. The
    pose is the one that the robot hears, as old as ``localization.delay`` makes it: never the true.
    """

    def enter(self, places: Sequence[Place]) -> None:
        """The place of each episode of the last ``reset``; most often one and the same."""

    def hear(self, poses: NDArray[np.float64], rows: NDArray[np.int64]) -> None:
        """Estimated poses (B, 3), m and rad in the frame of the place, of the episodes at ``rows``
        (B,): those that the observations of the next ``act`` belong to.
        """


def episode_generator(seed: int, world: int) -> np.random.Generator:
    """The planner's own generator in one world: (run seed, world id, POLICY stream)."""
    sequence = np.random.SeedSequence(seed, spawn_key=(world, 0, Stream.POLICY))
    return np.random.Generator(np.random.PCG64(sequence))
