"""The actors a learner knows: who they are, what they last delivered, whether they live."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

from learner.timing import Rates

_WINDOW = 16  # uploads that may overtake one that is still on its way
_SLOW_AFTER = 5.0  # s without an acknowledged chunk beyond the actor's own rhythm


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
    last_ack: float | None = None  # monotonic s
    interval: float = 0.0  # s between its last two chunks
    version: int = 0
    steps: int = 0
    restarts: int = 0
    time_split: dict[str, float] = field(default_factory=dict)
    rates: Rates = field(default_factory=Rates)


class Roster:
    """Thread-safe table of actors with the accepted sequences of every incarnation."""

    def __init__(self) -> None:
        self._members: dict[str, Member] = {}
        self._sequences: dict[tuple[str, str], Sequences] = {}
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
            member.incarnation, member.host, member.pid = incarnation, host, pid
            member.worlds, member.alive = worlds, True
            return member

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
        with self._lock:
            known = self._sequences.setdefault((actor_id, incarnation), Sequences())
            missing = known.add(sequence)
            member = self._members[actor_id]
            if member.last_ack is not None:
                member.interval = now - member.last_ack
            member.last_ack, member.alive = now, True
            member.steps += steps
            member.version = version
            total = sum(timing.values())
            member.time_split = {k: v / total for k, v in timing.items()} if total > 0 else {}
            member.rates.add(steps)
            return missing

    def counts(self) -> tuple[int, int]:
        """How many actors live, and how many were ever seen."""
        with self._lock:
            members = list(self._members.values())
        return sum(m.alive for m in members), len(members)

    def rows(self, weights_version: int) -> list[dict[str, Any]]:
        """The actors as status rows."""
        now = time.monotonic()
        with self._lock:
            members = list(self._members.values())
        rows = []
        for member in members:
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
                    "time_split": member.time_split,
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
