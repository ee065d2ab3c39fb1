"""What a fleet should reach, from what a chunk costs; docs/scaling.md explains it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

SENDERS = 16
"""Actors that fill the door when its costs are measured: few, and always with more at hand."""
SMALL, LARGE = 1, 32
"""Worlds of each of them, in turn: the chunks between which all others lie."""
EVERY = 0.005
"""s between two chunks that each of them offers: more than any door takes."""


@dataclass(frozen=True)
class ChunkCost:
    """s between two chunks at a door that is full: ``each`` of them, and ``step`` for every control
    step that it holds. Senders share the machine, so this is of one machine, and of the whole way
    from an actor's message to its acknowledgement, not of one thread.
    """

    each: float
    step: float

    def steps_per_second(self, offered: float, samples: int) -> float:
        """What is acknowledged of ``offered`` steps/s in chunks of ``samples`` steps."""
        return min(offered, samples / (self.each + self.step * samples))


def fitted(small: tuple[int, float], large: tuple[int, float]) -> ChunkCost:
    """The costs behind two full doors, each as (steps in a chunk, chunks per s)."""
    (few, often), (many, seldom) = small, large
    step = max(0.0, (1.0 / seldom - 1.0 / often) / (many - few))
    return ChunkCost(max(0.0, 1.0 / often - step * few), step)


def calibrated(full_door: Callable[[int], dict[str, Any]], horizon: int) -> ChunkCost:
    """The costs here and now; ``full_door`` measures a row of SENDERS with so many worlds."""
    rates = {worlds: full_door(worlds)["chunks_per_second"] for worlds in (SMALL, LARGE)}
    return fitted((SMALL * horizon, rates[SMALL]), (LARGE * horizon, rates[LARGE]))
