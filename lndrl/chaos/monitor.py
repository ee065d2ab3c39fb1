"""Watches a chaos run from outside: the ledger as it grows, /proc, and what a dashboard sees."""

from __future__ import annotations

import os
import statistics
import threading
import time
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lndrl.chaos.ledger import parse
from lndrl.errors import UserError
from lndrl.transport import open_viewer

SAMPLE_EVERY = 1.0
WARM_UP = 60.0
"""s after a learner's first update until its memory is looked at."""

LIFE_LEAST = 60.0
"""s of measured life below which growth says nothing."""


class Tail:
    """The lines that a file has gained since the last look; the file need not exist yet."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._position = 0
        self._rest = b""

    def lines(self) -> list[str]:
        """New whole lines."""
        try:
            with self.path.open("rb") as file:
                if os.fstat(file.fileno()).st_size < self._position:
                    self._position, self._rest = 0, b""  # it was rotated
                file.seek(self._position)
                data = file.read()
        except OSError:
            return []
        self._position += len(data)
        *whole, self._rest = (self._rest + data).split(b"\n")
        return [line.decode(errors="replace") for line in whole]


@dataclass
class Life:
    """One process of the learner: (s, bytes, file handles) once a second after warming up."""

    pid: int
    started: float
    first_update: float | None = None
    samples: list[tuple[float, int, int]] = field(default_factory=list)

    def fifths(self, column: int) -> list[float]:
        """The medians of five equally long parts of the life; none for one too short."""
        if not self.samples or self.samples[-1][0] - self.samples[0][0] < LIFE_LEAST:
            return []
        first, last = self.samples[0][0], self.samples[-1][0]
        parts: list[list[int]] = [[] for _ in range(5)]
        for row in self.samples:
            parts[min(4, int(5.0 * (row[0] - first) / (last - first)))].append(int(row[column]))
        return [statistics.median(part) for part in parts if part]

    def growth(self, column: int) -> float | None:
        """Last over first fifth of the life, less 1; None for one too short."""
        fifths = self.fifths(column)
        return fifths[-1] / fifths[0] - 1.0 if fifths else None


class Monitor:
    """Call ``look`` often; it costs milliseconds. Times are monotonic s."""

    def __init__(self, ledger: Path, endpoint: str) -> None:
        self.updates: deque[tuple[float, int]] = deque(maxlen=100_000)
        self.trained = 0
        self.accepted: dict[str, int] = {}
        self.arrivals: deque[tuple[float, str, int]] = deque(maxlen=20_000)
        self.lives: list[Life] = []
        self._tail = Tail(ledger)
        self._sampled = 0.0
        self._viewer = StatusWatch(endpoint)

    def learner_started(self, pid: int) -> None:
        """Another process is the learner now."""
        self.lives.append(Life(pid, time.monotonic()))

    def look(self) -> None:
        """Take in what has happened since the last look."""
        now = time.monotonic()
        for line in self._tail.lines():
            entry = parse(line)
            if entry is None:
                continue
            if entry.get("kind") == "trained":
                self._note_update(now, int(entry["samples"]))
            elif entry.get("kind") == "accepted":
                name, samples = str(entry["actor"]), int(entry["samples"])
                self.accepted[name] = self.accepted.get(name, 0) + samples
                self.arrivals.append((now, name, samples))
        if self.lives and now - self._sampled >= SAMPLE_EVERY:
            self._sampled = now
            self._sample(self.lives[-1], now)

    def updated_since(self, moment: float) -> float | None:
        """When the first update after ``moment`` was seen."""
        return next((seen for seen, _ in self.updates if seen > moment), None)

    def rate(self, begin: float, end: float) -> float:
        """Samples trained per second between two moments."""
        total = sum(samples for seen, samples in self.updates if begin < seen <= end)
        return total / max(end - begin, 1e-9)

    def arrived(self, actors: Collection[str], begin: float, end: float) -> int:
        """Samples of these actors that were accepted between two moments, of the newest only."""
        return sum(
            samples
            for seen, name, samples in self.arrivals
            if begin < seen <= end and name in actors
        )

    def state_of(self, pid: int) -> str | None:
        """What the newest status says of the actor with that process id."""
        row = self._row(pid)
        return None if row is None else str(row.get("state"))

    def name_of(self, pid: int) -> str | None:
        """By which name the newest status knows the actor with that process id."""
        row = self._row(pid)
        return None if row is None else str(row.get("id"))

    def memory_growth(self) -> float | None:
        """The largest growth of a learner's memory over one of its lives, as a share."""
        return max((g for life in self.lives if (g := life.growth(1)) is not None), default=None)

    def memory_by_fifth(self) -> list[float]:
        """Megabytes in the fifths of the longest life: whether it grew on, or at first only."""
        longest = max(self.lives, key=lambda life: len(life.samples), default=None)
        return [] if longest is None else [round(m / 1e6, 1) for m in longest.fifths(1)]

    def handle_growth(self) -> int | None:
        """The most file handles that a learner gained over one of its lives."""
        lives = [life for life in self.lives if life.growth(2) is not None]
        gains = [life.samples[-1][2] - life.samples[0][2] for life in lives]
        return max(gains, default=None)

    def longest_life(self) -> float:
        """s of the longest life, after warming up."""
        spans = [life.samples[-1][0] - life.samples[0][0] for life in self.lives if life.samples]
        return max(spans, default=0.0)

    def close(self) -> None:
        """Stop watching."""
        self._viewer.close()

    def _row(self, pid: int) -> dict[str, Any] | None:
        status = self._viewer.newest
        rows = [] if status is None else status.get("actors", [])
        return next((row for row in rows if row.get("pid") == pid), None)

    def _note_update(self, now: float, samples: int) -> None:
        self.trained += samples
        self.updates.append((now, samples))
        if self.lives and self.lives[-1].first_update is None:
            self.lives[-1].first_update = now

    def _sample(self, life: Life, now: float) -> None:
        if life.first_update is None or now < life.first_update + WARM_UP:
            return
        used = resources(life.pid)
        if used is not None:
            life.samples.append((now, *used))


class StatusWatch:
    """Keeps the newest status of a learner that may come and go, in a thread of its own."""

    def __init__(self, endpoint: str) -> None:
        self.newest: dict[str, Any] | None = None
        self._endpoint = endpoint
        self._closed = threading.Event()
        self._viewer = open_viewer(endpoint)
        self._thread = threading.Thread(target=self._watch, name="status-watch", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop watching."""
        self._closed.set()
        self._viewer.close()
        self._thread.join(5.0)

    def _watch(self) -> None:
        while not self._closed.is_set():
            try:
                for status in self._viewer.stream(1.0):
                    self.newest = status if status is not None else self.newest
                    if self._closed.is_set():
                        return
            except UserError:
                self._closed.wait(0.5)


def cpu_seconds(pid: int) -> float | None:
    """CPU time that a process has taken so far, in s; None when it is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text("utf-8").rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    except (OSError, IndexError, ValueError):
        return None


def resources(pid: int) -> tuple[int, int] | None:
    """Resident bytes and open file handles of a process; None when it is gone."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text("utf-8").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE"), len(os.listdir(f"/proc/{pid}/fd"))
    except (OSError, IndexError, ValueError):
        return None
