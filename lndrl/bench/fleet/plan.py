"""What a fleet bench shall measure, from the command line."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lndrl.config import MOST_ACTORS
from lndrl.errors import UserError

RATE = 300.0
"""Control steps per second that every synthetic actor offers: a real one of one fast core."""
MOST_ACTORS_PLAYED = MOST_ACTORS
UPDATES = ("drain", "real")


@dataclass(frozen=True)
class Plan:
    """``actors``: a row for each number. ``update`` drain: batches are counted as trained, and the
    networks stay as they are; real: the learner learns. ``every``: s between two chunks of an
    actor, None for as many as make RATE. ``seconds``: timed s of a row, at least.
    """

    actors: tuple[int, ...]
    update: str = "drain"
    every: float | None = None
    seconds: float = 10.0

    def period(self, samples: int) -> float:
        """s between two chunks of ``samples`` control steps that an actor offers."""
        return samples / RATE if self.every is None else self.every

    def span(self, samples: int) -> float:
        """Timed s: whole periods, at least two, so that every actor sends as often as it should."""
        period = self.period(samples)
        return max(2, math.ceil(self.seconds / period)) * period


def plan_of(
    actors: str, update: str = "drain", every: float | None = None, seconds: float = 10.0
) -> Plan:
    """A plan from what the command line says; raises UserError with one sentence."""
    numbers = []
    for word in actors.split(","):
        number = int(word) if word.strip().isdecimal() else 0
        if not 1 <= number <= MOST_ACTORS_PLAYED:
            raise UserError(
                f"--actors {actors}: {word.strip() or 'nothing'!r} is not a number of actors from"
                f" 1 to {MOST_ACTORS_PLAYED}; write them like 1,8,64"
            )
        numbers.append(number)
    if update not in UPDATES:
        raise UserError(f"--update {update}: must be {' or '.join(UPDATES)}")
    if every is not None and not every > 0:
        raise UserError(f"--every {every:g}: must be above 0")
    return Plan(tuple(numbers), update, every, seconds)
