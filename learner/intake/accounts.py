"""What became of every chunk that was acknowledged: trained, dropped by a named rule, or waiting.

``accepted = trained + dropped + waiting`` holds at any moment, in chunks and in samples. The
ledger file tells the same to whoever wants to check, and after a crash it tells the learner what
its checkpoint does not know.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any

from learner.intake.ledger import LEDGER_FILE, RULES, ChunkId, History, Ledger, Tally, chunk_id
from learner.intake.parts import Part, PartLedger, append, appended_to, parts_in, remove_parts

__all__ = ["Accounts", "ChunkId", "Recovery", "joined", "summed"]


@dataclass
class Recovery:
    """What a resumed learner has to know beside its checkpoint.

    lost: what was dropped by ``restart`` just now; excused: chunks unknown to the checkpoint that
    were ever dropped so, which may come again if their senders never heard of it; settled: other
    chunks unknown to it, which must not come again; newest_version: of the weights that were
    ever published; notes: for the event log.
    """

    lost: Tally = field(default_factory=Tally)
    excused: list[ChunkId] = field(default_factory=list)
    settled: list[ChunkId] = field(default_factory=list)
    newest_version: int = 0
    notes: list[str] = field(default_factory=list)


class Accounts:
    """The learner's books. Thread-safe; every entry is in the ledger when a method returns."""

    def __init__(self, ledger: Ledger | None = None) -> None:
        self._ledger = ledger or Ledger(None)
        self._accepted, self._trained = Tally(), Tally()
        self._dropped = {rule: Tally() for rule in RULES}
        self._open: dict[ChunkId, int] = {}
        self._lock = Lock()

    def accept(self, chunk: ChunkId, samples: int) -> None:
        """A chunk is about to be acknowledged."""
        with self._lock:
            self._accepted.add(samples)
            self._open[chunk] = samples
            self._ledger.accepted(chunk, samples)

    def train(self, update: int, chunks: Iterable[ChunkId]) -> None:
        """Update number ``update`` has succeeded on these."""
        with self._lock:
            settled, samples = self._settle(chunks)
            self._trained.add(samples, len(settled))
            self._ledger.trained(update, settled, samples)

    def drop(self, rule: str, chunks: Iterable[ChunkId]) -> None:
        """These will not be trained on, by one of RULES."""
        with self._lock:
            self._drop(rule, chunks)

    def checkpointed(self, update: int, step: int, others: Sequence[dict[str, Any]] = ()) -> None:
        """A checkpoint is on disk; ``others``: the totals of the other ranks in it."""
        with self._lock:
            self._ledger.checkpoint(update, step, summed([self._totals(), *others]))

    def fold(self, parts: Sequence[Part], known: frozenset[str] = frozenset()) -> None:
        """Take the lines of other ranks into the ledger, but for parts that are ``known`` there."""
        with self._lock:
            append(self._ledger, parts, known)

    def fold_left(self, folder: Path, elsewhere: Sequence[Part]) -> None:
        """Take in what ranks have left in the run's ``folder``, and on other machines."""
        parts = [*parts_in(folder), *elsewhere]
        if parts:
            self.fold(parts, appended_to(folder / LEDGER_FILE))
            if self._ledger.flush():
                remove_parts(folder)

    def excerpt(self) -> tuple[dict[str, Any], Part]:
        """Of a rank other than 0: its books, and the part of the ledger behind them."""
        assert isinstance(self._ledger, PartLedger)
        with self._lock:
            return self._state(), self._ledger.part

    def begin_part(self, taken: int) -> None:
        """Rank 0 has the first ``taken`` lines of this rank's part: begin another."""
        assert isinstance(self._ledger, PartLedger)
        with self._lock:
            self._ledger.begin(taken)

    def leave(self) -> None:
        """Rank 0 has all that this rank has noted: forget its part."""
        assert isinstance(self._ledger, PartLedger)
        with self._lock:
            self._ledger.leave()

    def dropped(self) -> dict[str, int]:
        """Chunks dropped, by rule."""
        with self._lock:
            return {rule: tally.chunks for rule, tally in self._dropped.items()}

    def totals(self) -> dict[str, Any]:
        """Chunks and samples as {accepted, trained, waiting: {...}, dropped: {rule: {...}}}."""
        with self._lock:
            return self._totals()

    def to_state(self) -> dict[str, Any]:
        """Plain data for a checkpoint: the totals and what waits."""
        with self._lock:
            return self._state()

    def resume(
        self,
        state: dict[str, Any] | None,
        update: int,
        is_known: Callable[[ChunkId], bool],
    ) -> Recovery:
        """Take up the books of a checkpoint at ``update`` and of the ledger behind it.

        ``state`` is None for checkpoints of before there were books; ``is_known`` says whether
        the checkpoint knows a chunk as accepted. Everything that was accepted and is not in the
        checkpoint as trained is dropped by ``restart``. A ledger that is missing or damaged is
        only noted. Raises ValueError, KeyError or TypeError for a ``state`` that is not one.
        """
        waiting: dict[ChunkId, int] = {}
        trained, accepted = Tally(), Tally()
        dropped = {rule: Tally() for rule in RULES}
        if state is not None:
            trained, accepted = Tally.read(state["trained"]), Tally.read(state["accepted"])
            dropped = {rule: Tally.read(state["dropped"][rule]) for rule in RULES}
            waiting = {chunk_id(row[:3]): int(row[3]) for row in state["open"]}
        history = self._ledger.history(update, waiting)
        recovery = Recovery(newest_version=max(update, history.newest_update))
        recovery.notes += history.notes(expected=state is not None)
        if not history.missing:
            accepted, dropped = history.accepted, history.dropped
        lost = _lost(history, waiting, is_known)
        recovery.lost = Tally(len(lost), sum(lost.values()))
        ended = {**history.ended, **dict.fromkeys(lost, "restart")}
        for chunk, rule in ended.items():
            if not is_known(chunk):
                (recovery.excused if rule == "restart" else recovery.settled).append(chunk)
        with self._lock:
            self._trained, self._dropped = trained, dropped
            self._open = dict(lost)
            counted = Tally.sum(trained, *dropped.values(), recovery.lost)
            if counted != accepted:
                recovery.notes.append(
                    f"the ledger says {accepted}, what is known of adds up to {counted}; "
                    "the latter counts"
                )
            self._accepted = counted
            self._drop("restart", list(lost), resumed=update)
        return recovery

    def flush(self) -> None:
        """Try to write what the disk has refused so far."""
        self._ledger.flush()

    def close(self) -> None:
        """Close the ledger."""
        self._ledger.close()

    # -- under the lock ----------------------------------------------------------------------

    def _drop(self, rule: str, chunks: Iterable[ChunkId], resumed: int | None = None) -> None:
        settled, samples = self._settle(chunks)
        self._dropped[rule].add(samples, len(settled))
        if resumed is not None:
            self._ledger.resumed(resumed)
        if settled:
            self._ledger.dropped(rule, settled, samples)

    def _settle(self, chunks: Iterable[ChunkId]) -> tuple[list[ChunkId], int]:
        """Those of ``chunks`` that are open, which they are no longer, and their samples."""
        settled = [chunk for chunk in chunks if chunk in self._open]
        return settled, sum(self._open.pop(chunk) for chunk in settled)

    def _state(self) -> dict[str, Any]:
        waiting = [[*chunk, samples] for chunk, samples in self._open.items()]
        return {**self._totals(), "open": waiting}

    def _totals(self) -> dict[str, Any]:
        return {
            "accepted": vars(self._accepted).copy(),
            "trained": vars(self._trained).copy(),
            "dropped": {rule: vars(tally).copy() for rule, tally in self._dropped.items()},
            "waiting": {"chunks": len(self._open), "samples": sum(self._open.values())},
        }


def summed(totals: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The totals of several ranks as those of one."""

    def tally(name: str, inner: str | None = None) -> dict[str, int]:
        found = [t[name] if inner is None else t[name][inner] for t in totals]
        return {unit: sum(each[unit] for each in found) for unit in ("chunks", "samples")}

    return {
        "accepted": tally("accepted"),
        "trained": tally("trained"),
        "dropped": {rule: tally("dropped", rule) for rule in RULES},
        "waiting": tally("waiting"),
    }


def joined(states: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What ``Accounts.to_state`` says on several ranks, as that of one."""
    return {**summed(states), "open": [row for state in states for row in state["open"]]}


def _lost(
    history: History, waiting: dict[ChunkId, int], is_known: Callable[[ChunkId], bool]
) -> dict[ChunkId, int]:
    """Samples of the chunks that were accepted and whose end the checkpoint does not know."""
    lost = {
        chunk: samples
        for chunk, samples in history.open.items()
        if chunk in waiting or not is_known(chunk)
    }
    unheard = {c: samples for c, samples in waiting.items() if c not in history.mentioned}
    return lost | unheard
