"""Where an actor's time goes, without gaps."""

from __future__ import annotations

import time
from collections.abc import Callable

from lndrl.transport.status import ACTOR_ACTIVITIES


class Laps:
    """A stopwatch that charges all time since its last lap to an activity.

    So the seconds by activity always sum to the wall time since the start, whatever lies between.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._seconds = dict.fromkeys(ACTOR_ACTIVITIES, 0.0)
        self._last = clock()

    def lap(self, activity: str) -> None:
        """Charge the time since the last lap to ``activity``, one of ACTOR_ACTIVITIES."""
        now = self._clock()
        self._seconds[activity] += now - self._last
        self._last = now

    def take(self) -> dict[str, float]:
        """Seconds by activity since the last ``take``; those up to now are ``other``."""
        self.lap("other")
        taken, self._seconds = self._seconds, dict.fromkeys(self._seconds, 0.0)
        return taken

    def restart(self) -> None:
        """Forget everything: what counts begins now."""
        self._seconds = dict.fromkeys(self._seconds, 0.0)
        self._last = self._clock()
