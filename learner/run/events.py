"""What happened, in words: a file for later, a ring for dashboards, a line for the terminal."""

from __future__ import annotations

import sys
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from threading import RLock
from typing import Any

from learner.run.flood import Flood
from learner.run.lines import LineFile

_LONGEST = 500  # letters of one event
_LIMIT = 8 * 2**20  # bytes of the file, and as much again in the one before


class EventLog:
    """Thread-safe; each event goes to ``path`` (appended), to the ring and to stderr.

    Never raises. A disk that refuses is said once, and again when it works. Beyond 8 MB the file
    goes on as ``PATH.1`` for one more round.
    """

    def __init__(self, path: Path | None, quiet: bool = False, keep: int = 50) -> None:
        self._quiet = quiet
        self._ring: deque[dict[str, Any]] = deque(maxlen=keep)
        self._flood = Flood()
        self._file = LineFile(path, self._on_change, _LIMIT, keep=1000) if path else None
        self._lock = RLock()

    def add(self, kind: str, text: str, sender: str | None = None) -> None:
        """Record one event; ``kind`` is a word such as join, leave, checkpoint.

        What others can cause names its ``sender``: many events of one kind and sender become one
        line with a count every few seconds.
        """
        with self._lock:
            self._tell_counts()
            if sender is None or self._flood.admits(kind, sender, time.monotonic()):
                self._tell(kind, text)

    def recent(self) -> list[dict[str, Any]]:
        """The newest events, oldest first."""
        with self._lock:
            self._tell_counts()
            return list(self._ring)

    def close(self) -> None:
        """Tell what was only counted so far, and close the file; it opens again when needed."""
        with self._lock:
            self._tell_counts(everything=True)
            if self._file is not None:
                self._file.close()

    def on_disk_change(self, what: str, error: OSError | None) -> None:
        """Say that the disk refuses ``what``, or takes it again."""
        if error is None:
            self.add("disk", f"{what} is written again")
        else:
            self.add("disk", f"{what} cannot be written ({error.strerror or error}); training on")

    def _tell_counts(self, everything: bool = False) -> None:
        now = time.monotonic()
        for kind, text in self._flood.counts(None if everything else now):
            self._tell(kind, text)

    def _tell(self, kind: str, text: str, to_file: bool = True) -> None:
        # A sender's words must not end lines or steer terminals.
        text = "".join(c if c.isprintable() else "?" for c in text[:_LONGEST])
        now = time.time()
        self._ring.append({"time": max(0.0, now), "kind": kind, "text": text})
        if not self._quiet:
            with suppress(OSError, ValueError):
                print(f"[{kind}] {text}", file=sys.stderr, flush=True)
        if to_file and self._file is not None:
            stamp = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(now))
            self._file.add(f"{stamp} {kind:<10} {text}")

    def _on_change(self, error: OSError | None) -> None:
        # Called while the file is written: what is said here goes elsewhere.
        if error is None:
            self._tell("disk", "events.log is written again", to_file=False)
        else:
            reason = error.strerror or error
            self._tell("disk", f"events.log cannot be written ({reason})", to_file=False)
