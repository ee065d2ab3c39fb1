"""Who plays in which worlds: families of world ids that never meet.

Everything random in an episode follows from (run seed, world id, episode), so two that share no
world id share no episode, whatever the run's seed is. What is chosen by looking at one family is
judged on another: training on actors' worlds, settings and sweeps by validation, the bench itself
by calibration, and the table by the bench alone.
"""

from __future__ import annotations

from enum import Enum

from lndrl.errors import UserError

WORLDS_PER_ACTOR = 100_000
"""World i of actor n is n * this + i; an actor has far fewer."""
ACTORS = 40_000
"""Actors with worlds of their own; actor n + this begins in those of actor n again."""


class Family(Enum):
    """A family of test episodes: episode k is played in the world ``world(k)``, as its number 0."""

    BENCH = "bench"
    """``lndrl benchmark``, and pictures of its episodes; nothing else."""
    VALIDATION = "validation"
    """``lndrl evaluate``, sweeps, tuning, ``play``: all that a person or program decides by."""
    CALIBRATION = "calibration"
    """``lndrl calibrate``: what the bench is chosen by."""

    @property
    def first(self) -> int:
        """World id of episode 0."""
        return _RANGES[self.value][0]

    @property
    def room(self) -> int:
        """How many episodes there are."""
        return _RANGES[self.value][1]

    def world(self, episode: int) -> int:
        """World id of ``episode``; raises UserError where the family has none of that number."""
        if not 0 <= episode < self.room:
            raise UserError(
                f"episode {episode} is none of {self.value}: it has 0 to {self.room - 1:,}"
            )
        return self.first + episode

    def episode(self, world: int) -> int:
        """The inverse of ``world``; raises ValueError for a world of others."""
        if not 0 <= world - self.first < self.room:
            raise ValueError(f"world {world} is none of {self.value}")
        return world - self.first


_RANGES = {
    # Version 1 of the bench was tested in these. From 4.1e9 on are the drives of lndrl
    # localization (``DRIVE_WORLD``).
    "bench": (4_000_000_000, 100_000_000),
    "validation": (5_000_000_000, 1_000_000_000),
    "calibration": (6_000_000_000, 1_000_000_000),
}


def episode_of(world: int) -> int:
    """The number of the episode that a family plays in ``world``.

    Raises ValueError for a world of no family.
    """
    for family in Family:
        if 0 <= world - family.first < family.room:
            return family.episode(world)
    raise ValueError(f"world {world} is of no family of test episodes")


def first_world_of_actor(index: int) -> int:
    """World id of an actor's first world, below all families whatever ``index`` is."""
    return index % ACTORS * WORLDS_PER_ACTOR
