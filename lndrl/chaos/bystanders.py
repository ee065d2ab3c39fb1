"""How the other actors fare while one is frozen."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from lndrl.chaos.monitor import Monitor

AFTER = 4.0
"""s after a freeze in which its actor connects again and sends what it had held back."""

LEAST = 3.0  # s of a freeze that says something
REMEMBERED = 120.0  # s; longer than any freeze and the time before it


@dataclass(frozen=True)
class Frozen:
    """A freeze that goes on, and the names of the actors that nothing was done to."""

    since: float
    others: tuple[str, ...]


class Bystanders:
    """Holds the others' rate during a freeze against the equally long time before it.

    Only where no other fault was felt in either, another freeze among them: such pairs would
    measure that. Times are monotonic s.
    """

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._frozen: dict[str, Frozen] = {}
        self._disturbed: list[tuple[float, float]] = []

    def disturbed(self, begin: float, seconds: float) -> None:
        """Another fault was felt, or will be, from ``begin`` on."""
        recent = time.monotonic() - REMEMBERED
        self._disturbed = [span for span in self._disturbed if span[1] > recent]
        self._disturbed.append((begin, begin + seconds))

    def frozen(self, target: str, others: Sequence[int]) -> None:
        """``target`` stands still now; ``others``: process ids of the other honest actors."""
        names = [self._monitor.name_of(pid) for pid in others]
        known = tuple(name for name in names if name is not None)
        self._frozen[target] = Frozen(time.monotonic(), known)

    def thawed(self, target: str) -> float | None:
        """The others' rate while ``target`` was frozen over the one before.

        None where nothing can be said: no others, or something else was going on.
        """
        frozen = self._frozen.pop(target, None)
        if frozen is None:
            return None
        self._monitor.look()
        now, since = time.monotonic(), frozen.since
        begin = since - (now - since)
        clear = not self._frozen and all(
            end <= begin or start >= now for start, end in self._disturbed
        )
        self.disturbed(since, now - since + AFTER)
        before = self._monitor.arrived(frozen.others, begin, since)
        if not clear or not before or now - since < LEAST:
            return None
        return self._monitor.arrived(frozen.others, since, now) / before
