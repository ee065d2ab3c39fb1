"""The learner's door: who may send, what counts as new, and how much may wait.

Runs on the transport's threads. An upload is acknowledged only when it is safe in the queue;
while the queue is full the acknowledgement waits, and so does the actor: that is the whole
back-pressure. Uploads are recognised by (actor, incarnation, sequence), so one that is sent
again is acknowledged again and trained on once.
"""

from __future__ import annotations

from threading import Condition
from typing import Any

from numpy.typing import NDArray

from learner.intake.accounts import Accounts
from learner.intake.chunks import Chunk, ChunkQueue, check_chunk, memory_of
from learner.intake.lanes import Lanes
from learner.intake.limits import chunk_too_large
from learner.intake.roster import Roster
from learner.run.events import EventLog
from learner.timing import Rates
from lndrl.config import MOST_WORLDS_PER_ACTOR, RunConfig
from lndrl.transport import (
    PROTOCOL_VERSION,
    UNKNOWN_ACTOR,
    Ack,
    ChunkHeader,
    Hello,
    Refusal,
    Welcome,
)
from lndrl.version import VERSION
from lndrl.wording import counted

__all__ = ["Chunk", "Ingest"]

_LONGEST_REASON = 500  # letters; what a sender wrote may be in it


class Ingest:
    """Handlers of the learner's endpoint and the bounded queue behind them."""

    def __init__(
        self,
        config: RunConfig,
        run_id: str,
        incarnation: str,
        roster: Roster,
        events: EventLog,
        accounts: Accounts | None = None,
        largest_message: int | None = None,
        lanes: Lanes | None = None,
    ) -> None:
        """``largest_message``: bytes of what the endpoint receives, if less than configured.

        ``lanes``: of the ranks that take in uploads, seen from this one; by default it is alone.
        """
        self.config = config
        self.lanes = lanes or Lanes()
        configured = config.transport.max_message_megabytes * 2**20
        self._largest_message = largest_message or configured
        self._config_data = config.model_dump(mode="json")  # for every actor that comes
        self.run_id = run_id
        self.incarnation = incarnation
        self.roster = roster
        self.events = events
        self.accounts = accounts or Accounts()
        self.weights_version = 0
        self.batch_size = config.ppo.batch_size  # samples of the next update
        self.newest_version = 0  # of all that were ever published; a crash may have undone some
        self.done = False
        self.shut = False
        self.answers = {"duplicate": 0, "refused": 0, "pause": 0}
        self.gaps = 0
        self.rates = Rates()
        self._queue = ChunkQueue()
        self._changed = Condition()

    @property
    def dropped(self) -> dict[str, int]:
        """Chunks that were not learned from: accepted ones by rule, others by answer."""
        return {**self.accounts.dropped(), **self.answers}

    # -- handlers, called on the transport's threads -----------------------------------------

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        """Admit an actor of the same program version and hand it the run's configuration."""
        if hello.protocol != PROTOCOL_VERSION or hello.program_version != VERSION:
            return Refusal(
                f"this learner is lndrl {VERSION} (protocol {PROTOCOL_VERSION}), the actor is "
                f"lndrl {hello.program_version[:40]} (protocol {hello.protocol}); install the same"
            )
        if self.done:
            return Refusal("this run is finished; start another learner")
        if too_large := chunk_too_large(self.config, hello.worlds, self._largest_message):
            self.events.add("refused", f"actor {hello.actor_id}: {too_large}", hello.actor_id)
            return Refusal(too_large)
        if hello.worlds > MOST_WORLDS_PER_ACTOR:
            return Refusal(f"an actor has at most {MOST_WORLDS_PER_ACTOR} worlds; start several")
        member = self.roster.join(
            hello.actor_id, hello.incarnation, hello.host, hello.pid, hello.worlds
        )
        if member is None:
            here = counted(self.roster.counts()[0], "actor is", "actors are")
            text = f"actor {hello.actor_id}: {here} here already"
            self.events.add("refused", text, hello.actor_id)
            return Refusal("this learner has all the actors that it can serve; stop one of them")
        again = member.kernels[1] > 0 or hello.kernels_needed > 0
        member.kernels = (hello.kernels_ready, hello.kernels_needed)
        if not again:
            text = f"actor {hello.actor_id} on {member.host}"
            self.events.add("join", text, sender=hello.actor_id)
        return Welcome(
            run_id=self.run_id,
            config=self._config_data,
            actor_index=member.index,
            weights_version=self.weights_version,
            learner_incarnation=self.incarnation,
            lane=self.lanes.of(hello.actor_id),
        )

    def on_chunk(self, header: ChunkHeader, arrays: dict[str, NDArray[Any]], size: int) -> Ack:
        """Check, wait for room, keep; the answer is the acknowledgement."""
        if self.done:
            return self._ack("accepted" if self._is_known(header) else "stale")
        if header.run_id != self.run_id:
            return self._refuse(header, f"run {header.run_id[:80]} is not this run ({self.run_id})")
        if not self.lanes.is_mine(header.actor_id):  # sent before it heard who takes it in now
            return self._ack("refused", UNKNOWN_ACTOR)
        if self._is_known(header):
            return self._count("duplicate")
        newest = max(self.weights_version, self.newest_version)
        try:
            trajectory, episodes = check_chunk(header, arrays, self.config, newest)
        except ValueError as error:
            return self._refuse(header, str(error))
        size = memory_of(trajectory, size)
        if not self._wait_for_room(header.actor_id, size):
            return self._ack("accepted") if self._is_known(header) else self._count("pause")
        member = self.roster.join(
            header.actor_id, header.incarnation, header.host, header.pid, header.worlds, hello=False
        )
        if member is None:
            return self._refuse(header, "this learner has all the actors that it can serve")
        self.roster.hear_load(header.actor_id, header.machine)
        chunk = Chunk(
            *(header.actor_id, header.incarnation, header.sequence, member.index),
            *(trajectory, episodes, size),
        )
        return self._accept(chunk, header.timing)

    def on_malformed(self, reason: str) -> None:
        """Something came that is no message at all; the transport has refused it."""
        self.answers["refused"] += 1
        self.events.add("refused", f"a malformed upload: {reason}", sender="someone")

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        """An actor's liveliness token appeared or vanished."""
        if self.roster.gone(actor_id, incarnation, alive):
            self.events.add("join" if alive else "leave", f"actor {actor_id}", sender=actor_id)

    # -- the learner's side ------------------------------------------------------------------

    def take(self, samples: int, timeout: float) -> list[Chunk] | None:
        """The oldest chunks that together hold ``samples``, or None after ``timeout`` s.

        Chunks older than ``max_lag`` weight versions are dropped and counted as stale. From now on
        there is room for so many.
        """
        with self._changed:
            if samples != self.batch_size:
                self.batch_size = samples
                self._changed.notify_all()  # who waits for room may find some
            self._drop_stale()
            self._changed.wait_for(lambda: self._queue.samples >= samples or self.done, timeout)
            self._drop_stale()
            if self._queue.samples < samples:
                return None
            taken = self._queue.take(samples)
            self._changed.notify_all()
            return taken

    def take_round(self, actors: int, timeout: float) -> list[Chunk] | None:
        """One chunk of each of ``actors`` actors, ordered by actor; None after ``timeout`` s."""
        with self._changed:
            self._changed.wait_for(lambda: self._queue.actors() >= actors or self.done, timeout)
            if self._queue.actors() < actors:
                return None
            taken = self._queue.take_first_of_each()
            self._changed.notify_all()
            return taken

    def stock(self, room: int) -> int:
        """Samples that wait and may be trained on; from now on there is room for ``room``."""
        with self._changed:
            self._drop_stale()
            if room != self.batch_size:
                self.batch_size = room
                self._changed.notify_all()
            return self._queue.samples

    def wait_for_more(self, than: int, timeout: float) -> None:
        """Wait until more than so many samples are here, or ``timeout`` s have passed."""
        with self._changed:
            self._changed.wait_for(lambda: self._queue.samples > than or self.done, timeout)

    def draw(self, samples: int) -> list[Chunk]:
        """The oldest chunks that together hold ``samples``, which ``stock`` has found here."""
        with self._changed:
            taken = self._queue.take(samples) if samples else []
            self._changed.notify_all()
            return taken

    def excerpt(self) -> dict[str, Any]:
        """Of a rank other than 0: roster, accounts and ledger of one moment, plain data."""
        with self._changed:
            accounts, part = self.accounts.excerpt()
            return {"roster": self.roster.to_state(), "accounts": accounts, "part": vars(part)}

    def to_state(self) -> dict[str, Any]:
        """Roster and accounts of one moment, for a checkpoint."""
        with self._changed:
            return {"roster": self.roster.to_state(), "accounts": self.accounts.to_state()}

    def close(self) -> None:
        """Accept nothing any more; what waits is dropped, as the run ends here."""
        with self._changed:
            self.shut = True
            self.accounts.drop("end", [chunk.id for chunk in self._queue.remove()])
            self._changed.notify_all()

    def finish(self) -> None:
        """Tell every actor that asks from now on that the run is done."""
        with self._changed:
            self.done = True
            self._changed.notify_all()

    def waiting(self) -> dict[str, float]:
        """What waits in the queue, for the status."""
        with self._changed:
            return {"chunks": len(self._queue), "megabytes": self._queue.bytes / 1e6}

    # -- small steps -------------------------------------------------------------------------

    def _accept(self, chunk: Chunk, timing: dict[str, float]) -> Ack:
        """Into books and queue in one moment, so that no checkpoint sees the one without it."""
        with self._changed:
            if self.roster.is_known(*chunk.id):
                return self._count("duplicate")
            if self.done or self.shut:
                return self._count("pause")
            self.accounts.accept(chunk.id, chunk.samples)
            version = int(chunk.trajectory.version.max())
            missing = self.roster.accepted(*chunk.id, chunk.samples, version, timing)
            self._queue.put(chunk)
            self._changed.notify_all()
        if missing:
            self.gaps += missing
            text = f"{counted(missing, 'chunk')} of actor {chunk.actor_id} never came"
            self.events.add("gap", text, sender=chunk.actor_id)
        self.rates.add(chunk.samples)
        return self._ack("accepted")

    def _drop_stale(self) -> None:
        limit = self.weights_version - self.config.learner.max_lag
        stale = self._queue.remove(lambda chunk: chunk.oldest_version < limit)
        if stale:
            self.accounts.drop("stale", [chunk.id for chunk in stale])
            self._changed.notify_all()

    def _has_room(self, actor_id: str, size: int) -> bool:
        learner = self.config.learner
        if learner.mode == "lockstep":
            # An honest actor waits for weights by itself.
            return self._queue.of(actor_id) <= self.config.transport.upload_window
        # A batch that has grown is made of as many chunks more, and all of them must find room.
        growth = max(1.0, self.batch_size / self.config.ppo.batch_size)
        # More than one batch in waiting would only grow old there.
        return self._queue.samples < self.batch_size and (
            not len(self._queue)
            or (
                len(self._queue) < growth * learner.queue_chunks
                and self._queue.bytes + size <= learner.queue_megabytes * 1e6
            )
        )

    def _wait_for_room(self, actor_id: str, size: int) -> bool:
        # Half the sender's patience: it hears "pause" before it would send again.
        timeout = 0.5 * self.config.transport.upload_timeout
        if self.config.learner.mode == "lockstep":
            timeout = 0.0  # who floods must not keep others waiting, on whom the round depends

        def over() -> bool:
            return self.done or self.shut

        with self._changed:
            self._changed.wait_for(lambda: self._has_room(actor_id, size) or over(), timeout)
            return self._has_room(actor_id, size) and not over()

    def _is_known(self, header: ChunkHeader) -> bool:
        return self.roster.is_known(header.actor_id, header.incarnation, header.sequence)

    def _refuse(self, header: ChunkHeader, reason: str) -> Ack:
        reason = reason[:_LONGEST_REASON]
        text = f"chunk {header.sequence} of {header.actor_id}: {reason}"
        self.events.add("refused", text, sender=header.actor_id)
        return self._count("refused", reason)

    def _count(self, status: str, reason: str = "") -> Ack:
        self.answers[status] += 1
        return self._ack(status, reason)

    def _ack(self, status: str, reason: str = "") -> Ack:
        return Ack(
            status=status,
            weights_version=self.weights_version,
            learner_incarnation=self.incarnation,
            reason=reason,
            done=self.done,
        )
