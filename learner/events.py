"""What happened, in words: a file for later, a ring for dashboards, a line for the terminal."""

from __future__ import annotations

import sys
import time
from collections import deque
from pathlib import Path
from threading import Lock
from typing import Any


class EventLog:
    """Thread-safe; each event goes to ``path`` (appended), to the ring and to stderr."""

    def __init__(self, path: Path | None, quiet: bool = False, keep: int = 50) -> None:
        self._path = path
        self._quiet = quiet
        self._ring: deque[dict[str, Any]] = deque(maxlen=keep)
        self._lock = Lock()

    def add(self, kind: str, text: str) -> None:
        """Record one event; ``kind`` is a word such as join, leave, checkpoint."""
        now = time.time()
        with self._lock:
            self._ring.append({"time": now, "kind": kind, "text": text})
            if self._path is not None:
                stamp = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(now))
                with self._path.open("a") as file:
                    file.write(f"{stamp} {kind:<10} {text}\n")
            if not self._quiet:
                print(f"[{kind}] {text}", file=sys.stderr, flush=True)

    def recent(self) -> list[dict[str, Any]]:
        """The newest events, oldest first."""
        with self._lock:
            return list(self._ring)
