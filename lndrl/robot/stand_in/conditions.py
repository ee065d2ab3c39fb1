"""What a network and its clocks do to messages: late, unevenly late, lost, stamped wrongly."""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass, field

import numpy as np

from lndrl.errors import UserError
from lndrl.robot.messages import SECOND, Content
from lndrl.robot.stand_in.body import shifted


@dataclass(frozen=True)
class Mute:
    """A topic that is silent from ``start`` s of the rehearsal on, for ``seconds``."""

    purpose: str
    start: float
    seconds: float

    def covers(self, purpose: str, time: float) -> bool:
        """Whether ``purpose`` is silent at ``time`` (s)."""
        return purpose == self.purpose and self.start <= time < self.start + self.seconds


@dataclass(frozen=True)
class Conditions:
    """What befalls the sensors' messages. Raises UserError for what cannot be."""

    delay: float = 0.0
    """s from the moment of a stamp to the sending."""
    jitter: float = 0.0
    """s, deviation of that; messages of one topic may overtake each other."""
    loss: float = 0.0
    """Share that is never sent; the map, poses and goals that are set by hand always are."""
    clock_offset: float = 0.0
    """s by which the robot's sensors' clock is ahead."""
    mutes: tuple[Mute, ...] = field(default_factory=tuple)

    def __post_init__(self) -> None:
        for name in ("delay", "jitter"):
            if not 0.0 <= getattr(self, name) <= 60.0:
                raise UserError(f"{name} {getattr(self, name):g}: must be 0 to 60 s")
        if not 0.0 <= self.loss <= 1.0:
            raise UserError(f"loss {self.loss:g}: must be a share, 0 to 1")
        if not abs(self.clock_offset) <= 1e6:
            raise UserError(f"clock_offset {self.clock_offset:g}: must be within a million s")


class Outbox:
    """Messages on their way, by when they are sent; ``seed`` starts the draws."""

    def __init__(self, conditions: Conditions, seed: int) -> None:
        self._conditions = conditions
        self._random = np.random.default_rng(seed)
        self._waiting: list[tuple[float, int, str, Content]] = []
        self._order = itertools.count()

    def add(self, purpose: str, content: Content, time: float) -> None:
        """A sensor's message that is made at ``time`` (s of the rehearsal)."""
        c = self._conditions
        # Drawn whether needed or not, so that one condition changes nothing of another.
        lost, late = self._random.random() < c.loss, self._random.normal()
        if lost or any(mute.covers(purpose, time) for mute in c.mutes):
            return
        due = time + max(c.delay + c.jitter * float(late), 0.0)
        content = shifted(content, round(c.clock_offset * SECOND))
        heapq.heappush(self._waiting, (due, next(self._order), purpose, content))

    def due(self, time: float) -> list[tuple[str, Content]]:
        """What is sent up to ``time``, in this order."""
        found = []
        while self._waiting and self._waiting[0][0] <= time + 1e-9:
            _, _, purpose, content = heapq.heappop(self._waiting)
            found.append((purpose, content))
        return found
