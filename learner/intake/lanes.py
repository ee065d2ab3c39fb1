"""Which rank of a learner takes in whose uploads."""

from __future__ import annotations

import zlib
from dataclasses import dataclass


@dataclass(frozen=True)
class Lanes:
    """The lanes of ``size`` ranks, seen from ``rank``.

    By the actor's name alone, so that every rank knows its own: a chunk that is sent again comes
    to the rank that has it, whatever was forgotten meanwhile.
    """

    rank: int = 0
    size: int = 1

    def of(self, actor_id: str) -> str:
        """The lane of an actor; empty where there is one rank."""
        return lane_of(self.rank_of(actor_id)) if self.size > 1 else ""

    def rank_of(self, actor_id: str) -> int:
        """The rank that takes in what an actor sends."""
        return zlib.crc32(actor_id.encode()) % self.size

    def is_mine(self, actor_id: str) -> bool:
        """Whether that is this one."""
        return self.size == 1 or self.rank_of(actor_id) == self.rank


def lane_of(rank: int) -> str:
    """What the lane of a rank is called."""
    return f"rank-{rank}"
