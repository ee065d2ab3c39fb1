"""The order in which a learner takes uploads in, so that who sends rubbish costs only himself.

Two lanes. Whoever had an upload accepted goes ahead; all others share a lane that every refusal
makes wait, for so long that refusing never takes more than ``REFUSING`` of one core. A newcomer
finds that lane empty and loses no time, unless somebody floods it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar

CAPACITY = 4096
"""Uploads that may wait in either lane, and senders that are trusted."""

PER_STRANGER = 32
"""Uploads of one sender that may wait before one of them was accepted."""

STRANGERS_BYTES = 512 * 2**20
"""Of all uploads together that wait in the strangers' lane: one of the largest finds room."""

REFUSING = 0.012
"""Share of a core for the thread that refuses; receiving and answering take up to twice as much."""


class Upload(Protocol):
    """What of ``zenoh.Query`` is used here."""

    @property
    def key_expr(self) -> Any: ...

    @property
    def payload(self) -> Any: ...

    def drop(self) -> None: ...


U = TypeVar("U", bound=Upload)


class UploadQueue(Generic[U]):
    """Uploads that wait for the handler, one per (actor, incarnation, sequence). Thread-safe.

    A chunk that was sent again replaces its older copy, so a long stall costs no memory, and
    Zenoh's own channel never fills up, which would block the reception of everything else. What
    is beyond the limits above is left unanswered: an honest actor sends it again.
    ``clock``: monotonic s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._changed = threading.Condition()
        self._known: dict[str, U] = {}
        self._strangers: dict[str, dict[str, U]] = {}  # by sender, each has its turn
        self._strangers_count = self._strangers_bytes = 0
        self._trusted: dict[str, None] = {}
        self._open_at = clock()  # the strangers' lane
        self._closed = False

    def put(self, upload: U) -> None:
        """Add an upload."""
        key = str(upload.key_expr)
        sender = _sender(key)
        with self._changed:
            trusted = sender in self._trusted
            lane = self._known if trusted else self._strangers.setdefault(sender, {})
            older = lane.get(key)
            if self._closed or not self._has_room(lane, trusted, upload, older):
                upload.drop()
                if not lane and not trusted:
                    del self._strangers[sender]
                return
            lane[key] = upload
            if not trusted:
                self._strangers_count += older is None
                self._strangers_bytes += _size(upload) - _size(older)
            if trusted or self._strangers_count == 1 or self._clock() >= self._open_at:
                self._changed.notify()  # else ``get`` knows when it goes on
        if older is not None:
            older.drop()

    def get(self) -> U | None:
        """The oldest upload of those whose turn it is; None when closed."""
        with self._changed:
            while not self._closed:
                if self._known:
                    return self._known.pop(next(iter(self._known)))
                patience = self._open_at - self._clock()
                if self._strangers and patience <= 0.0:
                    return self._next_stranger()
                self._changed.wait(patience if self._strangers else None)
            return None

    def settle(self, upload: U, status: str, seconds: float) -> None:
        """Note how an upload was answered (an Ack's status), and the CPU s that this took."""
        sender = _sender(str(upload.key_expr))
        with self._changed:
            if status == "accepted":
                self._trust(sender)
            elif status == "refused":
                self._distrust(sender)
                self._open_at = max(self._open_at, self._clock()) + seconds / REFUSING

    def close(self) -> None:
        """Wake up ``get`` and forget what waits; the actors still have it."""
        with self._changed:
            self._closed = True
            self._known.clear()
            self._strangers.clear()
            self._changed.notify_all()

    def _has_room(self, lane: dict[str, U], trusted: bool, upload: U, older: U | None) -> bool:
        if trusted:
            return older is not None or len(self._known) < CAPACITY
        if older is None and (len(lane) >= PER_STRANGER or self._strangers_count >= CAPACITY):
            return False
        return self._strangers_bytes + _size(upload) - _size(older) <= STRANGERS_BYTES

    def _next_stranger(self) -> U:
        sender = next(iter(self._strangers))
        lane = self._strangers.pop(sender)
        upload = lane.pop(next(iter(lane)))
        if lane:
            self._strangers[sender] = lane
        self._strangers_count -= 1
        self._strangers_bytes -= _size(upload)
        return upload

    def _trust(self, sender: str) -> None:
        # The one heard of longest ago is forgotten first.
        self._trusted.pop(sender, None)
        self._trusted[sender] = None
        if len(self._trusted) > CAPACITY:
            del self._trusted[next(iter(self._trusted))]
        lane = self._strangers.pop(sender, {})
        self._strangers_count -= len(lane)
        self._strangers_bytes -= sum(map(_size, lane.values()))
        self._known.update(lane)

    def _distrust(self, sender: str) -> None:
        if sender not in self._trusted:
            return
        del self._trusted[sender]
        waiting = {key: u for key, u in self._known.items() if _sender(key) == sender}
        for key, upload in waiting.items():
            del self._known[key]
            self._strangers.setdefault(sender, {})[key] = upload
            self._strangers_count += 1
            self._strangers_bytes += _size(upload)


def _sender(key: str) -> str:
    """Actor and incarnation, of ``.../ACTOR/INCARNATION/SEQUENCE``."""
    return key.rpartition("/")[0]


def _size(upload: Upload | None) -> int:
    return 0 if upload is None or upload.payload is None else len(upload.payload)
