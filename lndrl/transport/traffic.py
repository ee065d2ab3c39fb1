"""What goes through a learner's door: uploads by answer, how long they wait, bytes both ways."""

from __future__ import annotations

from bisect import bisect_left
from threading import Lock

from lndrl.transport.status import UPLOAD_SECONDS

ANSWERS = ("accepted", "duplicate", "refused", "pause")
"""How an upload is answered; whatever else a newer Ack says counts as refused."""


class Traffic:
    """Counts since the door was opened. Thread-safe; its lock is held for additions alone."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._answers = dict.fromkeys(ANSWERS, 0)
        self._waits = [0] * (len(UPLOAD_SECONDS) + 1)
        self._seconds = 0.0
        self._bytes = self._weights = self._weights_bytes = 0

    def answered(self, status: str, size: int, seconds: float) -> None:
        """An upload of ``size`` bytes was answered with ``status``, so long after it had come."""
        status = status if status in self._answers else "refused"
        with self._lock:
            self._answers[status] += 1
            self._waits[bisect_left(UPLOAD_SECONDS, seconds)] += 1
            self._seconds += seconds
            self._bytes += size

    def handed_out(self, size: int) -> None:
        """Somebody asked for weights and gets ``size`` bytes."""
        with self._lock:
            self._weights += 1
            self._weights_bytes += size

    def counts(self) -> dict[str, float]:
        """Everything by one flat name each, so that the counts of several doors can be added.

        See ``lndrl.transport.status.Traffic``, which ``traffic_of`` makes of it.
        """
        with self._lock:
            return {
                **{f"answer_{name}": count for name, count in self._answers.items()},
                **{f"wait_{i}": count for i, count in enumerate(self._waits)},
                "seconds": self._seconds,
                "bytes": self._bytes,
                "weights": self._weights,
                "weights_bytes": self._weights_bytes,
            }


def traffic_of(counts: dict[str, float]) -> dict[str, object]:
    """The counts of one door or of several as a status has them, plain data."""
    return {
        "answers": {name: int(counts[f"answer_{name}"]) for name in ANSWERS},
        "waits": [int(counts[f"wait_{i}"]) for i in range(len(UPLOAD_SECONDS) + 1)],
        "wait_seconds": counts["seconds"],
        "bytes": int(counts["bytes"]),
        "weights": int(counts["weights"]),
        "weights_bytes": int(counts["weights_bytes"]),
    }
