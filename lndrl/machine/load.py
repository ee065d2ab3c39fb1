"""How busy the machine is that a process runs on: CPU, memory and GPUs, as shares."""

from __future__ import annotations

import threading
import time

import psutil

from lndrl.machine.cores import machine_cores
from lndrl.machine.gpu import Cards


class Load:
    """CPU since the last look, and memory in use, of the whole machine. Thread-safe.

    Looks at most every ``every`` s, so that asking for it with each chunk costs nothing.
    """

    def __init__(self, every: float = 2.0) -> None:
        self._every = every
        self._lock = threading.Lock()
        self._looked = time.monotonic()
        self._before = _cpu_seconds()
        self._cards = Cards()
        self._known: dict[str, float] = {}

    def now(self) -> dict[str, float]:
        """``cpu`` and ``memory`` in use (shares), ``cores``, ``gigabytes`` (2^30 bytes) in all,
        and what ``Cards`` knows of GPUs.

        Empty before there is something to say.
        """
        with self._lock:
            if time.monotonic() >= self._looked + self._every:
                self._look()
            return dict(self._known)

    def _look(self) -> None:
        self._looked = time.monotonic()
        after = _cpu_seconds()
        busy, total = (now - then for now, then in zip(after, self._before, strict=True))
        self._before = after
        memory = psutil.virtual_memory()
        self._known = {
            "cpu": min(max(busy / total, 0.0), 1.0) if total > 0 else 0.0,
            "memory": min(max(1.0 - memory.available / memory.total, 0.0), 1.0),
            "cores": float(machine_cores()),
            "gigabytes": memory.total / 2**30,
            **self._cards.now(),
        }


def _cpu_seconds() -> tuple[float, float]:
    """Busy and all s of all cores since the machine started."""
    times = psutil.cpu_times()
    # Linux counts a guest's time in user, too.
    total = sum(times) - getattr(times, "guest", 0.0) - getattr(times, "guest_nice", 0.0)
    return total - times.idle - getattr(times, "iowait", 0.0), total
