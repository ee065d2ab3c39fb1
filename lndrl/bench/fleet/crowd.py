"""Synthetic actors, many in one process: they send what a real one collected, and wait for acks.

One thread plays them all. A chunk is sent when it is due and the window has room, and again, under
the same number, when no answer comes or the learner asks for a pause, as a real actor does.
"""

from __future__ import annotations

import heapq
import json
import queue
import secrets
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.bench.fleet.chunk import Template
from lndrl.config import RunConfig
from lndrl.transport import Ack, Hello
from lndrl.transport.ledger import PAUSE
from lndrl.transport.zenoh.light import LightActor
from lndrl.version import VERSION

FETCH_PATIENCE = 120.0
_REST = 0.2  # s after an upload that had no answer
_IDLE = 0.02  # s of one wait for news


@dataclass
class Played:
    """One synthetic actor. Times are monotonic s."""

    hello: Hello
    link: LightActor
    template: Template
    window: int
    due: float = 0.0
    sequence: int = 0
    open: dict[int, float] = field(default_factory=dict)  # sequence: first sent
    held: int = 0
    fetching: bool = False


class Crowd:
    """``count`` actors at ``endpoint``, numbered from ``first``; ``period``: s between chunks."""

    def __init__(
        self,
        endpoint: str,
        config: RunConfig,
        arrays: dict[str, NDArray[np.generic]],
        first: int,
        count: int,
        period: float,
    ) -> None:
        self.newest = 0
        self._fetches = False
        self.latencies: list[float] = []
        self.accepted = 0  # samples
        self._counts = 0.0, 0.0
        self._period, self._patience = period, config.transport.upload_timeout
        self._book: list[dict[str, Any]] = []
        # No SimpleQueue, as in lndrl/robot/link/session.py: it may outwait Ctrl-C.
        self._notes: queue.Queue[tuple[Any, ...]] = queue.Queue()
        self._later: list[tuple[float, int, int]] = []  # when, actor, sequence: to be sent again
        self._sending = False
        self.actors = [
            self._joined(endpoint, config, arrays, number) for number in range(first, first + count)
        ]
        self._due: list[tuple[float, int]] = []

    def begin(self) -> None:
        """Send from now on; the actors' first chunks are spread over a period."""
        now = time.monotonic()
        for place, actor in enumerate(self.actors):
            actor.due = now + self._period * (place + 0.5) / len(self.actors)
        self._due = [(actor.due, place) for place, actor in enumerate(self.actors)]
        heapq.heapify(self._due)
        self._sending = True

    def count(self, begin: float, end: float) -> None:
        """Count what is acknowledged between two moments, and how long that took."""
        self.latencies, self.accepted, self._counts = [], 0, (begin, end)

    def turn(self) -> None:
        """Hear, and send what is due; call it again and again."""
        now = time.monotonic()
        nexts = [heap[0][0] for heap in (self._due, self._later) if heap]
        patience = max(0.0, min([_IDLE, *(moment - now for moment in nexts)]))
        try:
            self._hear(*self._notes.get(timeout=patience))
            while True:
                self._hear(*self._notes.get_nowait())
        except queue.Empty:
            pass
        now = time.monotonic()
        while self._later and self._later[0][0] <= now:
            _, place, sequence = heapq.heappop(self._later)
            self._send(place, sequence)
        while self._sending and self._due and self._due[0][0] <= now:
            self._send_next(heapq.heappop(self._due)[1], now)

    def finish(self, patience: float) -> bool:
        """Send nothing new and wait for the answers; whether all came within ``patience`` s."""
        self._sending, self._due = False, []
        deadline = time.monotonic() + patience
        while any(actor.open for actor in self.actors) and time.monotonic() < deadline:
            self.turn()
        return not any(actor.open for actor in self.actors)

    def fetch(self) -> None:
        """From now on get all weights that are announced."""
        self._fetches = True
        self._fetch_all()

    def hold(self, version: int) -> bool:
        """Whether all have weights of ``version`` or newer ones."""
        return all(actor.held >= version for actor in self.actors)

    def write_book(self, path: Path) -> None:
        """What was produced and settled, as ``lndrl actor --ledger`` writes it."""
        with path.open("w", encoding="utf-8") as file:
            file.writelines(json.dumps(line) + "\n" for line in self._book)

    def close(self) -> None:
        """Leave."""
        for actor in self.actors:
            actor.link.close()

    # -- one actor ---------------------------------------------------------------------------

    def _joined(
        self,
        endpoint: str,
        config: RunConfig,
        arrays: dict[str, NDArray[np.generic]],
        number: int,
    ) -> Played:
        worlds = arrays["action"].shape[1]
        name = f"synthetic-{number:04d}"
        hello = Hello(name, secrets.token_hex(8), "bench", number + 1, worlds, VERSION)
        link = LightActor(endpoint, config.transport)
        welcome = link.join(hello, partial(self._note, "news", number))
        template = Template(welcome.run_id, hello, arrays)
        held = max(0, welcome.weights_version)
        template.hold(held)
        self.newest = max(self.newest, held)
        return Played(hello, link, template, config.transport.upload_window, held=held)

    def _note(self, *note: Any) -> None:
        self._notes.put(note)

    def _send_next(self, place: int, now: float) -> None:
        actor = self.actors[place]
        if len(actor.open) >= actor.window:
            actor.due = float("inf")  # until an answer makes room
            return
        actor.sequence += 1
        actor.open[actor.sequence] = now
        self._say("produced", actor, actor.sequence, samples=actor.template.samples)
        self._send(place, actor.sequence)
        # Whoever was held up does not catch up by a burst: his worlds stood still meanwhile.
        actor.due = max(actor.due + self._period, now)
        heapq.heappush(self._due, (actor.due, place))

    def _send(self, place: int, sequence: int) -> None:
        actor = self.actors[place]
        payload = actor.template.chunk(sequence)
        heard = partial(self._note, "ack", place, sequence)
        actor.link.upload(actor.hello, sequence, payload, self._patience, heard)

    def _hear(self, kind: str, place: int, *what: Any) -> None:
        if kind == "ack":
            self._settle(place, *what)
        elif kind == "news":
            self._heard_of(int(what[0]))
        else:
            self._hold(place, what[0])

    def _settle(self, place: int, sequence: int, ack: Ack | None) -> None:
        actor, now = self.actors[place], time.monotonic()
        if sequence not in actor.open:
            return
        if ack is None or ack.status == "pause":
            rest = _REST if ack is None else PAUSE
            heapq.heappush(self._later, (now + rest, place, sequence))
            return
        self._heard_of(ack.weights_version)
        sent = actor.open.pop(sequence)
        self._say("settled", actor, sequence, status=ack.status)
        begin, end = self._counts
        if ack.status in ("accepted", "duplicate") and begin <= now < end:
            self.latencies.append(now - sent)
            self.accepted += actor.template.samples
        if actor.due == float("inf") and self._sending:
            actor.due = now
            heapq.heappush(self._due, (now, place))

    def _heard_of(self, version: int) -> None:
        if version > self.newest:
            self.newest = version
            self._fetch_all()

    def _fetch_all(self) -> None:
        if self._fetches:
            for place in range(len(self.actors)):
                self._fetch(place)

    def _fetch(self, place: int) -> None:
        actor = self.actors[place]
        if not actor.fetching and actor.held < self.newest:
            actor.fetching = True
            actor.link.fetch(FETCH_PATIENCE, partial(self._note, "weights", place))

    def _hold(self, place: int, found: tuple[int, int] | None) -> None:
        actor = self.actors[place]
        actor.fetching = False
        if found is not None:
            actor.held = max(actor.held, found[0])
            actor.template.hold(actor.held)
        if self._fetches:
            self._fetch(place)

    def _say(self, kind: str, actor: Played, sequence: int, **more: Any) -> None:
        name, life = actor.hello.actor_id, actor.hello.incarnation
        self._book.append({"kind": kind, "actor": name, "life": life, "sequence": sequence, **more})
