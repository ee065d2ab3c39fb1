"""Where the learner's time goes: shares of the last minute by activity."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock


class TimeSplit:
    """Records which activity ran when; one thread writes, any thread reads."""

    def __init__(
        self,
        activities: tuple[str, ...],
        window: float = 60.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._activities = activities
        self._window = window
        self._clock = clock
        self._past: deque[tuple[str, float, float]] = deque()
        self._current: tuple[str, float] | None = None
        self._totals = dict.fromkeys(activities, 0.0)
        self._lock = Lock()

    @contextmanager
    def during(self, activity: str) -> Iterator[None]:
        """Count the time inside the block as ``activity``; blocks do not nest."""
        begin = self._clock()
        with self._lock:
            self._current = (activity, begin)
        try:
            yield
        finally:
            end = self._clock()
            with self._lock:
                self._current = None
                self._past.append((activity, begin, end))
                self._totals[activity] += end - begin
                while self._past and self._past[0][2] < end - self._window:
                    self._past.popleft()

    def totals(self) -> dict[str, float]:
        """Seconds by activity since the start, finished blocks only."""
        with self._lock:
            return dict(self._totals)

    def shares(self) -> dict[str, float]:
        """Fractions of the recorded part of the window by activity; they sum to 1 or are 0."""
        now = self._clock()
        with self._lock:
            pieces = list(self._past)
            if self._current:
                pieces.append((*self._current, now))
        seconds = dict.fromkeys(self._activities, 0.0)
        for activity, begin, end in pieces:
            seconds[activity] += max(0.0, end - max(begin, now - self._window))
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
            self._marks.append((self._clock(), self._marks[-1][1] + count))
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
