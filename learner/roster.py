"""The actors a learner knows: who they are, what they last delivered, whether they live."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

from learner.timing import Rates
from lndrl.transport.status import ACTOR_ACTIVITIES, shares_of

_WINDOW = 16  # uploads that may overtake one that is still on its way
_SLOW_AFTER = 5.0  # s without an acknowledged chunk beyond the actor's own rhythm
_WINDOW_SECONDS = 60.0  # behind every share of an actor's time


class Sequences:
    """Which sequences of one incarnation were accepted; uploads may overtake one another.

    Sequences count from 1. Everything below ``next`` is settled; ``beyond`` holds those that came
    early. A hole that stays behind ``_WINDOW`` later uploads is given up as lost.
    """

    def __init__(self, next_sequence: int = 1, beyond: set[int] | None = None) -> None:
        self.next = next_sequence
        self.beyond = beyond or set()

    def __contains__(self, sequence: int) -> bool:
        return sequence < self.next or sequence in self.beyond

    def add(self, sequence: int) -> int:
        """Note an accepted sequence; returns how many were given up as lost by that."""
        self.beyond.add(sequence)
        lost = 0
        if len(self.beyond) > _WINDOW:
            lost = min(self.beyond) - self.next
            self.next = min(self.beyond)
        while self.next in self.beyond:
            self.beyond.remove(self.next)
            self.next += 1
        return lost


@dataclass
class Member:
    """One actor, over all its incarnations."""

    actor_id: str
    index: int
    incarnation: str = ""
    host: str = ""
    pid: int = 0
    worlds: int = 0
    alive: bool = True
    retired: bool = False  # taken away on purpose: nobody need worry
    last_ack: float | None = None  # monotonic s
    interval: float = 0.0  # s between its last two chunks
    version: int = 0
    steps: int = 0
    restarts: int = 0
    timings: deque[tuple[float, dict[str, float]]] = field(default_factory=deque)
    rates: Rates = field(default_factory=Rates)

    def seconds(self, since: float) -> dict[str, float]:
        """By activity, of the newest chunk and all that came after ``since`` (monotonic s)."""
        newest = len(self.timings) - 1
        total: dict[str, float] = {}
        for i, (came, timing) in enumerate(self.timings):
            if came > since or i == newest:
                _add(total, timing)
        return total


class Roster:
    """Thread-safe table of actors with the accepted sequences of every incarnation."""

    def __init__(self) -> None:
        self._members: dict[str, Member] = {}
        self._sequences: dict[tuple[str, str], Sequences] = {}
        self._totals: dict[str, float] = {}  # s by activity of all chunks ever accepted
        self._lock = Lock()

    def join(self, actor_id: str, incarnation: str, host: str, pid: int, worlds: int) -> Member:
        """Register an actor or its new incarnation; the index of an id never changes."""
        with self._lock:
            member = self._members.get(actor_id)
            if member is None:
                member = Member(actor_id, index=len(self._members))
                self._members[actor_id] = member
            elif member.incarnation not in ("", incarnation):
                member.restarts += 1
            # A chunk may still be on its way from an actor that was taken away.
            member.retired = member.retired and member.incarnation == incarnation
            member.incarnation, member.host, member.pid = incarnation, host, pid
            member.worlds, member.alive = worlds, True
            return member

    def retire(self, actor_id: str) -> None:
        """Leave an actor out of the rows once it is gone: it was taken away on purpose."""
        with self._lock:
            if actor_id in self._members:
                self._members[actor_id].retired = True

    def gone(self, actor_id: str, incarnation: str, alive: bool) -> bool:
        """Note a liveliness change; True when it changed what was known of this incarnation."""
        with self._lock:
            member = self._members.get(actor_id)
            if member is None or member.incarnation != incarnation or member.alive == alive:
                return False
            member.alive = alive
            return True

    def is_known(self, actor_id: str, incarnation: str, sequence: int) -> bool:
        """Whether this upload was accepted before."""
        with self._lock:
            known = self._sequences.get((actor_id, incarnation))
            return known is not None and sequence in known

    def accepted(
        self,
        actor_id: str,
        incarnation: str,
        sequence: int,
        steps: int,
        version: int,
        timing: dict[str, float],
    ) -> int:
        """Note an accepted chunk of a member that has joined; returns chunks found missing."""
        now = time.monotonic()
        timing = {k: max(0.0, v) for k, v in timing.items() if k in ACTOR_ACTIVITIES}
        with self._lock:
            known = self._sequences.setdefault((actor_id, incarnation), Sequences())
            missing = known.add(sequence)
            member = self._members[actor_id]
            if member.last_ack is not None:
                member.interval = now - member.last_ack
            member.last_ack, member.alive = now, True
            member.steps += steps
            member.version = version
            member.timings.append((now, timing))
            while member.timings[0][0] < now - _WINDOW_SECONDS:
                member.timings.popleft()
            _add(self._totals, timing)
            member.rates.add(steps)
            return missing

    def counts(self) -> tuple[int, int]:
        """How many actors live, and how many were ever seen."""
        with self._lock:
            members = list(self._members.values())
        return sum(m.alive for m in members), len(members)

    def steps(self) -> int:
        """Environment steps of all chunks accepted since this learner started."""
        with self._lock:
            return sum(member.steps for member in self._members.values())

    def totals(self) -> dict[str, float]:
        """Seconds by activity of all actors since this learner started."""
        with self._lock:
            return dict(self._totals)

    def shares(self, window: float = _WINDOW_SECONDS) -> dict[str, float]:
        """Shares by activity of the living actors' last ``window`` s, all together.

        Of at most the last minute. Empty before the first chunk.
        """
        since = time.monotonic() - window
        total: dict[str, float] = {}
        with self._lock:
            for member in self._members.values():
                if member.alive:
                    _add(total, member.seconds(since))
        return shares_of(total)

    def rows(self, weights_version: int) -> list[dict[str, Any]]:
        """The actors as status rows."""
        now = time.monotonic()
        with self._lock:
            members = [m for m in self._members.values() if m.alive or not m.retired]
            seconds = [member.seconds(now - _WINDOW_SECONDS) for member in members]
        rows = []
        for member, spent in zip(members, seconds, strict=True):
            age = None if member.last_ack is None else now - member.last_ack
            slow = age is not None and age > _SLOW_AFTER + 3.0 * member.interval
            rows.append(
                {
                    "id": member.actor_id,
                    "host": member.host,
                    "pid": member.pid,
                    "worlds": member.worlds,
                    "state": "gone" if not member.alive else ("slow" if slow else "active"),
                    "last_ack_age": age,
                    "lag": max(0, weights_version - member.version),
                    "steps": member.steps,
                    "rate": member.rates.rate(60.0) if member.alive else 0.0,
                    "restarts": member.restarts,
                    "time_split": shares_of(spent),
                }
            )
        return rows

    def to_state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        with self._lock:
            return {
                "actors": {m.actor_id: m.index for m in self._members.values()},
                "sequences": [
                    [actor, incarnation, known.next, sorted(known.beyond)]
                    for (actor, incarnation), known in self._sequences.items()
                ],
            }

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the table of a checkpoint; its actors count as gone until heard of."""
        with self._lock:
            for actor_id, index in state["actors"].items():
                self._members[actor_id] = Member(actor_id, index=index, alive=False)
            self._sequences = {
                (actor, incarnation): Sequences(following, set(beyond))
                for actor, incarnation, following, beyond in state["sequences"]
            }


def _add(total: dict[str, float], seconds: Mapping[str, float]) -> None:
    for name, value in seconds.items():
        total[name] = total.get(name, 0.0) + value
