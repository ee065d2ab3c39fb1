"""The actors a learner knows: who they are, what they last delivered, whether they live."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

from learner.intake.ledger import ChunkId
from learner.intake.sequences import Sequences
from learner.timing import Rates
from lndrl.config import MOST_ACTORS
from lndrl.transport.status import ACTOR_ACTIVITIES, shares_of

_SLOW_AFTER = 5.0  # s without an acknowledged chunk beyond the actor's own rhythm
_RHYTHM = 8  # chunks that tell the rhythm
_SLACK = 60.0  # s of activity that a chunk may report beyond the time since the one before
_TIMINGS = 4096  # chunks whose timing is remembered, of each actor
_REMEMBERED = 600.0  # s that somebody who left without delivering anything stays in the table
_LONGEST_HOST = 64  # letters
_LIVES = 8  # incarnations of one actor whose sequences are remembered
_LATE = 2  # chunks of a vanished actor that may have been on their way
_WINDOW_SECONDS = 60.0  # behind every share of an actor's time


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
    joined: float = field(default_factory=lambda: time.monotonic())
    left: float = field(default_factory=lambda: time.monotonic())  # where it is gone
    last_ack: float | None = None  # monotonic s
    intervals: deque[float] = field(default_factory=lambda: deque(maxlen=_RHYTHM))  # s
    kernels: tuple[int, int] = (0, 0)  # that it has, of those that it needs; while it compiles
    late: int = 0  # chunks that came since it vanished
    machine: dict[str, float] = field(default_factory=dict)  # how busy its host is
    version: int = 0
    steps: int = 0
    restarts: int = 0
    seen: deque[str] = field(default_factory=lambda: deque(maxlen=_LIVES))  # incarnations
    lives: dict[str, Sequences] = field(default_factory=dict)  # the one heard of last is last
    timings: deque[tuple[float, dict[str, float]]] = field(
        default_factory=lambda: deque(maxlen=_TIMINGS)
    )
    rates: Rates = field(default_factory=Rates)

    @property
    def last_heard(self) -> float:
        """Monotonic s of its last chunk, or of when it joined."""
        return self.joined if self.last_ack is None else self.last_ack

    def sequences(self, incarnation: str) -> Sequences:
        """Those of ``incarnation``; only the last few that delivered anything are remembered."""
        known = self.lives.pop(incarnation, None) or Sequences()
        while len(self.lives) >= _LIVES:
            del self.lives[next(iter(self.lives))]
        self.lives[incarnation] = known
        return known

    def become(self, incarnation: str) -> None:
        """Go on as ``incarnation``."""
        if incarnation not in self.seen:
            self.restarts += bool(self.seen)
            self.seen.append(incarnation)
        # A chunk may still be on its way from an actor that was taken away.
        self.retired = self.retired and self.incarnation == incarnation
        if self.incarnation != incarnation:
            self.incarnation, self.alive, self.kernels = incarnation, True, (0, 0)

    def state(self, now: float) -> str:
        """active, slow or gone at ``now`` (monotonic s)."""
        if not self.alive:
            return "gone"
        silent = 0.0 if self.last_ack is None else now - self.last_ack
        return "slow" if silent > _SLOW_AFTER + max(self.intervals, default=0.0) else "active"

    def seconds(self, since: float) -> dict[str, float]:
        """By activity, of the newest chunk and all that came after ``since`` (monotonic s)."""
        newest = len(self.timings) - 1
        total: dict[str, float] = {}
        for i, (came, timing) in enumerate(self.timings):
            if came > since or i == newest:
                _add(total, timing)
        return total

    def delivered(self, steps: int, version: int, timing: Mapping[str, float]) -> dict[str, float]:
        """Note a chunk that was accepted now; returns its timing as far as it can be true."""
        now = time.monotonic()
        told = {k: max(0.0, v) for k, v in timing.items() if k in ACTOR_ACTIVITIES}
        most, total = max(0.0, now - self.last_heard) + _SLACK, sum(told.values())
        if total > most:
            told = {name: value * (most / total) for name, value in told.items()}
        if self.last_ack is not None and self.alive:
            self.intervals.append(now - self.last_ack)
        self.last_ack = now
        self.kernels = (0, 0)
        if not self.alive:
            # What was on its way when an actor froze or died does not bring it back to life.
            self.late += 1
            self.alive = self.late > _LATE
        self.steps += steps
        self.version = version
        self.timings.append((now, told))
        while self.timings[0][0] < now - _WINDOW_SECONDS:
            self.timings.popleft()
        self.rates.add(steps)
        return told


class Roster:
    """Thread-safe table of actors with the accepted sequences of their incarnations.

    Bounded: who leaves without delivering anything is forgotten after a while, and beyond ``most``
    actors, one that is gone or never delivered anything.
    """

    def __init__(self, most: int = MOST_ACTORS) -> None:
        self._most = most
        self._members: dict[str, Member] = {}
        self._next_index = 0
        self._totals: dict[str, float] = {}  # s by activity of all chunks ever accepted
        self._lock = Lock()

    def join(
        self,
        actor_id: str,
        incarnation: str,
        host: str,
        pid: int,
        worlds: int,
        hello: bool = True,
    ) -> Member | None:
        """Register an actor or its new incarnation; the index of an id never changes.

        ``hello``: the actor said so itself just now, it is no chunk that was on its way. None
        when there are too many actors.
        """
        with self._lock:
            member = self._member(actor_id)
            if member is not None:
                member.become(incarnation)
                member.host = "".join(c if c.isprintable() else "?" for c in host[:_LONGEST_HOST])
                member.pid, member.worlds = pid, worlds
                member.alive = member.alive or hello
            return member

    def hear_load(self, actor_id: str, machine: Mapping[str, float]) -> None:
        """What an actor says of the machine that it runs on."""
        with self._lock:
            if actor_id in self._members:
                self._members[actor_id].machine = dict(machine)

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
            member.alive, member.late = alive, 0
            member.left = time.monotonic()
            return True

    def is_known(self, actor_id: str, incarnation: str, sequence: int) -> bool:
        """Whether this upload was accepted before."""
        with self._lock:
            member = self._members.get(actor_id)
            known = member.lives.get(incarnation) if member is not None else None
            return known is not None and sequence in known

    def accepted(
        self,
        actor_id: str,
        incarnation: str,
        sequence: int,
        steps: int,
        version: int,
        timing: Mapping[str, float],
    ) -> int:
        """Note an accepted chunk of a member that has joined; returns chunks found missing."""
        with self._lock:
            member = self._members[actor_id]
            missing = member.sequences(incarnation).add(sequence)
            _add(self._totals, member.delivered(steps, version, timing))
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
        return shares_of(self.seconds(window))

    def seconds(self, window: float = _WINDOW_SECONDS) -> dict[str, float]:
        """What ``shares`` are shares of."""
        since = time.monotonic() - window
        total: dict[str, float] = {}
        with self._lock:
            for member in self._members.values():
                if member.alive:
                    _add(total, member.seconds(since))
        return total

    def rows(self, weights_version: int) -> list[dict[str, Any]]:
        """The actors as status rows."""
        now = time.monotonic()
        with self._lock:
            members = [m for m in self._members.values() if m.alive or not m.retired]
            seconds = [member.seconds(now - _WINDOW_SECONDS) for member in members]
        rows = []
        for member, spent in zip(members, seconds, strict=True):
            age = None if member.last_ack is None else max(0.0, now - member.last_ack)
            rows.append(
                {
                    "id": member.actor_id,
                    "host": member.host,
                    "pid": member.pid,
                    "worlds": member.worlds,
                    "state": member.state(now),
                    "last_ack_age": age,
                    "gone_for": None if member.alive else max(0.0, now - member.left),
                    "kernels_ready": member.kernels[0],
                    "kernels_needed": member.kernels[1],
                    "lag": max(0, weights_version - member.version),
                    "steps": member.steps,
                    "rate": member.rates.rate(60.0) if member.alive else 0.0,
                    "restarts": member.restarts,
                    "time_split": shares_of(spent),
                    "machine": member.machine,
                }
            )
        return rows

    def to_state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        with self._lock:
            return {
                "actors": {m.actor_id: m.index for m in self._members.values()},
                "next_index": self._next_index,
                "sequences": [
                    [
                        *(member.actor_id, incarnation),
                        *(known.next, sorted(known.beyond), known.holes),
                    ]
                    for member in self._members.values()
                    for incarnation, known in member.lives.items()
                ],
            }

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the table of a checkpoint; its actors count as gone until heard of.

        Raises KeyError, TypeError or ValueError for what is no such table.
        """
        indices = {str(actor): int(index) for actor, index in state["actors"].items()}
        with self._lock:
            self._members = {a: Member(a, index, alive=False) for a, index in indices.items()}
            after = max(indices.values(), default=-1) + 1
            self._next_index = max(after, int(state.get("next_index", 0)))
            for actor, incarnation, following, beyond, *holes in state["sequences"]:
                lives = self._members[actor].lives
                # Checkpoints of older versions know no holes.
                known = [(int(first), int(last)) for first, last in (holes or [[]])[0]]
                lives[str(incarnation)] = Sequences(int(following), map(int, beyond), known)

    def reconcile(self, settled: Iterable[ChunkId], excused: Iterable[ChunkId]) -> None:
        """After ``restore``: what else must not come again, and what need not come."""
        with self._lock:
            for chunks, note in ((settled, Sequences.settle), (excused, Sequences.excuse)):
                for actor, incarnation, sequence in chunks:
                    known = actor in self._members
                    member = self._member(actor)
                    if member is not None:
                        member.alive = member.alive and known
                        note(member.sequences(incarnation), sequence)

    def _member(self, actor_id: str) -> Member | None:
        """The actor's row, a new one where there is none yet and room for it."""
        if actor_id not in self._members:
            self._forget_idle()
            if len(self._members) >= self._most and not self._forget_one():
                return None
            self._members[actor_id] = Member(actor_id, self._next_index)
            self._next_index += 1
        return self._members[actor_id]

    def _forget_idle(self) -> None:
        before = time.monotonic() - _REMEMBERED
        for member in list(self._members.values()):
            if not member.alive and not member.lives and member.left < before:
                del self._members[member.actor_id]

    def _forget_one(self) -> bool:
        free = [m for m in self._members.values() if not (m.alive and m.lives)]
        if not free:
            return False
        # Whoever delivered something is worth more than whoever only said hello.
        oldest = min(free, key=lambda m: (bool(m.lives), m.alive, m.last_heard))
        del self._members[oldest.actor_id]
        return True


def _add(total: dict[str, float], seconds: Mapping[str, float]) -> None:
    for name, value in seconds.items():
        total[name] = total.get(name, 0.0) + value
