"""Where the learner's time goes: shares of the last minute by activity."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock

_FINEST = 0.1  # s between marks of a rate


class TimeSplit:
    """Records which activity ran when; one thread writes, any thread reads.

    The time between two activities counts as ``other``, which ``activities`` must name, so that
    all time from the first one on is accounted for.
    """

    def __init__(
        self,
        activities: tuple[str, ...],
        window: float = 60.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._window = window
        self._clock = clock
        self._past: deque[tuple[str, float, float]] = deque()
        self._current: tuple[str, float] | None = None
        self._totals = dict.fromkeys(activities, 0.0)
        self._lock = Lock()

    @contextmanager
    def during(self, activity: str) -> Iterator[None]:
        """Count the time inside the block as ``activity``; blocks do not nest."""
        self._begin(activity)
        try:
            yield
        finally:
            self._begin("other")

    def _begin(self, activity: str) -> None:
        """End what runs and begin ``activity``."""
        now = self._clock()
        with self._lock:
            if self._current is not None:
                name, begin = self._current
                self._past.append((name, begin, now))
                self._totals[name] += now - begin
                while self._past[0][2] < now - self._window:
                    self._past.popleft()
            self._current = (activity, now)

    def totals(self) -> dict[str, float]:
        """Seconds by activity since the first one began; they sum to all the time since then."""
        now = self._clock()
        with self._lock:
            totals = dict(self._totals)
            if self._current is not None:
                totals[self._current[0]] += now - self._current[1]
        return totals

    def shares(self, window: float | None = None) -> dict[str, float]:
        """Fractions of the last ``window`` s by activity, as far as recorded.

        They sum to 1, or are 0 before the first activity. At most the window of the record.
        """
        now = self._clock()
        first = now - min(self._window, self._window if window is None else window)
        with self._lock:
            pieces = list(self._past)
            if self._current is not None:
                pieces.append((*self._current, now))
        seconds = dict.fromkeys(self._totals, 0.0)
        for activity, begin, end in pieces:
            seconds[activity] += max(0.0, end - max(begin, first))
        total = sum(seconds.values())
        return {name: value / total if total > 0 else 0.0 for name, value in seconds.items()}


class Rates:
    """Events per second over several windows, from a growing count."""

    def __init__(
        self, windows: tuple[int, ...] = (10, 60, 300), clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._windows = windows
        self._clock = clock
        self._marks: deque[tuple[float, int]] = deque([(clock(), 0)])
        self._lock = Lock()

    def add(self, count: int) -> None:
        """Count ``count`` more events now."""
        with self._lock:
            mark = self._clock(), self._marks[-1][1] + count
            # However fast things come, a second costs no more than a few marks.
            if len(self._marks) > 2 and mark[0] - self._marks[-2][0] < _FINEST:
                self._marks[-1] = mark
            else:
                self._marks.append(mark)
            horizon = self._marks[-1][0] - self._windows[-1]
            while len(self._marks) > 2 and self._marks[1][0] < horizon:
                self._marks.popleft()

    def rate(self, window: float) -> float:
        """Events per second over the last ``window`` seconds."""
        now = self._clock()
        with self._lock:
            marks = list(self._marks)
        before = marks[0]
        for mark in marks:
            if mark[0] > now - window:
                break
            before = mark
        # A burst that arrived at once still took the time since the mark before it.
        elapsed = max(now - before[0], 1e-6)
        return (marks[-1][1] - before[1]) / elapsed

    def all(self) -> dict[str, float]:
        """Rates by window, keys such as "10s"."""
        return {f"{window}s": self.rate(window) for window in self._windows}
