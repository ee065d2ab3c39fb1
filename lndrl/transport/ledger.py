"""An actor's book of uploads: what waits, what is on its way, what the learner said.

Both transports use it, so the rules of sending again stand once. Thread-safe.
"""

from __future__ import annotations

import json
import logging
import os
import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lndrl.errors import UserError
from lndrl.transport.messages import NO_WEIGHTS, UNKNOWN_ACTOR, Ack, Welcome

PAUSE = 0.25
MAX_ACKS = 1000
logger = logging.getLogger(__name__)


@dataclass(eq=False)
class Entry:
    """One encoded chunk until it is settled. ``due``: monotonic s before which it rests.

    ``samples`` is what a ``Book`` says of it.
    """

    actor_id: str
    incarnation: str
    sequence: int
    payload: bytes
    samples: int = 0
    due: float = 0.0
    in_flight: bool = False
    epoch: int = 0


class Book:
    """A file with a JSON line for every chunk that enters the window and every one settled.

    Each line is one write that appends, so all actors of a machine may share a file. Raises
    UserError when it cannot be opened; a line that cannot be written later is a warning, because
    an actor is there to collect samples.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        except OSError as error:
            raise UserError(f"--ledger {path}: cannot be written ({error.strerror})") from None

    def note(self, kind: str, entry: Entry, **more: Any) -> None:
        """Append what happened to ``entry``."""
        line = {
            "kind": kind,
            "actor": entry.actor_id,
            "life": entry.incarnation,
            "sequence": entry.sequence,
            **more,
        }
        try:
            os.write(self._file, json.dumps(line).encode() + b"\n")
        except OSError as error:
            logger.warning("%s: a line could not be written (%s)", self._path, error.strerror)

    def close(self) -> None:
        """Give the file back; nothing may be noted any more."""
        os.close(self._file)


class Ledger:
    """Uploads in order of sequence, at most ``window`` unsettled, plus all that acks tell."""

    def __init__(self, window: int) -> None:
        self.window = window
        self._closed = False
        self._changed = threading.Condition()
        self._entries: list[Entry] = []
        self._acks: deque[Ack] = deque(maxlen=MAX_ACKS)
        self._newest = NO_WEIGHTS
        self._incarnation = ""
        self._welcomed_by = ""
        self._retired: set[str] = set()
        self._epoch = 0
        self._held = False
        self._needs_hello = False
        self._done = False
        self._heard_at = time.monotonic()
        self._book: Book | None = None

    def widen(self, window: int) -> None:
        """Let ``window`` uploads be unsettled from now on, or fewer than before."""
        with self._changed:
            self.window = window
            self._changed.notify_all()

    def keep_book(self, path: Path) -> None:
        """Note every chunk in ``path`` from now on; raises UserError when that cannot be."""
        self._book = Book(path)

    # -- the actor's thread

    def check_ready(self) -> None:
        """Raise RuntimeError unless an upload makes sense now."""
        with self._changed:
            if self._closed:
                raise RuntimeError("the endpoint is closed")
            if not self._epoch:
                raise RuntimeError("say hello before the first upload")
            if self._needs_hello and len(self._entries) > self.window:
                raise RuntimeError("another learner answered: say hello again before uploading")

    def closed(self) -> bool:
        """Whether the endpoint was closed."""
        return self._closed

    def has_room(self) -> bool:
        """Whether an upload may be added now; see ``ActorEndpoint.upload``."""
        with self._changed:
            return self._room()

    def wait_room(self, timeout: float | None) -> None:
        """Block until ``has_room``, or until closed; raises TimeoutError."""
        deadline = None if timeout is None else time.monotonic() + timeout
        with self._changed:
            while not self._room():
                if deadline is not None and time.monotonic() >= deadline:
                    raise TimeoutError(f"no upload was settled within {timeout:g} s")
                # A bounded wait keeps Ctrl-C prompt on every platform.
                self._changed.wait(0.2 if timeout is None else min(0.2, timeout))

    def add(self, entry: Entry) -> None:
        """Enter a chunk, last in the queue."""
        with self._changed:
            if self._book is not None and not self._closed:
                self._book.note("produced", entry, samples=entry.samples)
            self._entries.append(entry)
            self._changed.notify_all()

    def wait_settled(self, timeout: float) -> bool:
        """Wait until nothing is pending; False when time ran out, or chunks wait for a hello."""
        deadline = time.monotonic() + timeout
        with self._changed:
            while self._entries:
                left = deadline - time.monotonic()
                if left <= 0 or self._closed or self._held:
                    return False
                self._changed.wait(min(left, 0.2))
            return True

    def wait_newer(self, version: int, timeout: float) -> bool:
        """See ``ActorEndpoint.wait_newer``."""
        deadline = time.monotonic() + timeout
        with self._changed:
            while not (self._newest != version or self._done or self._needs_hello or self._closed):
                left = deadline - time.monotonic()
                if left <= 0:
                    return False
                self._changed.wait(min(left, 0.2))
            return True

    def drain_acks(self) -> list[Ack]:
        """Acks since the last call."""
        with self._changed:
            acks = list(self._acks)
            self._acks.clear()
            return acks

    def pending(self) -> int:
        """Chunks not yet settled."""
        with self._changed:
            return len(self._entries)

    def silence(self) -> float:
        """Seconds since the learner was last heard."""
        with self._changed:
            return time.monotonic() - self._heard_at

    def newest(self) -> tuple[int, str]:
        """Newest known version and the learner that has it."""
        with self._changed:
            return self._newest, self._incarnation

    def needs_hello(self) -> bool:
        """Whether another learner than the welcoming one answered."""
        with self._changed:
            return self._needs_hello

    def done(self) -> bool:
        """Whether training has finished."""
        with self._changed:
            return self._done

    # -- the sending side

    def take(self, block: bool = True) -> Entry | None:
        """The oldest chunk that waits, now marked as on its way; None when closed.

        Without ``block`` also None when there is nothing to send at this moment.
        """
        with self._changed:
            while not self._closed:
                entry = next((e for e in self._entries if not e.in_flight), None)
                rest = None
                if entry is not None and not self._held:
                    rest = entry.due - time.monotonic()
                    if rest <= 0:
                        entry.in_flight, entry.epoch = True, self._epoch
                        return entry
                if not block:
                    return None
                self._changed.wait(rest)
            return None

    def postpone(self, entry: Entry, delay: float) -> None:
        """No answer came: send the same sequence again after ``delay`` seconds."""
        with self._changed:
            entry.in_flight, entry.due = False, time.monotonic() + delay
            self._changed.notify_all()

    def settle(self, entry: Entry, ack: Ack) -> None:
        """Book the learner's answer to a chunk."""
        self.heard(ack.weights_version, ack.learner_incarnation, ack.done)
        if ack.status == "pause":
            self.postpone(entry, PAUSE)
        elif ack.status == "refused" and ack.reason == UNKNOWN_ACTOR:
            with self._changed:
                # A refusal of what was sent before the latest hello says nothing any more.
                if entry.epoch == self._epoch:
                    self._held = self._needs_hello = True
            self.postpone(entry, 0.0)
        else:
            with self._changed:
                # Two sends of one chunk can both be answered; the first answer counts.
                if entry in self._entries:
                    self._entries.remove(entry)
                    self._acks.append(ack)
                    if self._book is not None:
                        self._book.note("settled", entry, status=ack.status)
                self._changed.notify_all()

    def heard(self, version: int, incarnation: str, done: bool = False) -> None:
        """Book a learner's newest version, from an ack or an announcement."""
        with self._changed:
            if incarnation in self._retired:
                return
            self._heard_at = time.monotonic()
            if incarnation != self._incarnation:
                self._retired.add(self._incarnation)
                self._incarnation, self._newest, self._done = incarnation, version, done
                self._needs_hello = self._epoch > 0 and incarnation != self._welcomed_by
            self._newest = max(self._newest, version)
            self._done = self._done or done
            self._changed.notify_all()

    def welcomed(self, welcome: Welcome) -> None:
        """A hello succeeded: chunks that were held go out again."""
        with self._changed:
            self._retired.discard(welcome.learner_incarnation)
            self._epoch += 1
            self._welcomed_by = welcome.learner_incarnation
            self._held = self._needs_hello = False
        self.heard(welcome.weights_version, welcome.learner_incarnation)

    def close(self) -> None:
        """Wake everybody up for good."""
        with self._changed:
            self._closed = True
            book, self._book = self._book, None
            if book is not None:
                book.close()
            self._changed.notify_all()

    def _room(self) -> bool:
        return self._closed or self._needs_hello or len(self._entries) < self.window
