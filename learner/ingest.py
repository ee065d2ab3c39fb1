"""The learner's door: who may send, what counts as new, and how much may wait.

Runs on the transport's threads. An upload is acknowledged only when it is safe in the queue;
while the queue is full the acknowledgement waits, and so does the actor: that is the whole
back-pressure. Uploads are recognised by (actor, incarnation, sequence), so one that is sent
again is acknowledged again and trained on once.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from threading import Condition
from typing import Any

from numpy.typing import NDArray

from learner.events import EventLog
from learner.roster import Roster
from learner.timing import Rates
from lndrl.config import RunConfig
from lndrl.navigation import EpisodeRecord, Trajectory
from lndrl.transport import PROTOCOL_VERSION, Ack, ChunkHeader, Hello, Refusal, Welcome
from lndrl.version import VERSION


@dataclass(frozen=True)
class Chunk:
    """An accepted upload."""

    actor_index: int
    sequence: int
    trajectory: Trajectory
    episodes: list[EpisodeRecord]
    size: int

    @property
    def samples(self) -> int:
        return self.trajectory.action.size

    @property
    def oldest_version(self) -> int:
        return int(self.trajectory.version.min())


class Ingest:
    """Handlers of the learner's endpoint and the bounded queue behind them."""

    def __init__(
        self, config: RunConfig, run_id: str, incarnation: str, roster: Roster, events: EventLog
    ) -> None:
        self.config = config
        self.run_id = run_id
        self.incarnation = incarnation
        self.roster = roster
        self.events = events
        self.weights_version = 0
        self.done = False
        self.dropped = {"stale": 0, "duplicate": 0, "refused": 0}
        self.gaps = 0
        self.rates = Rates()
        self._queue: deque[Chunk] = deque()
        self._samples = 0
        self._bytes = 0
        self._changed = Condition()

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
        member = self.roster.join(
            hello.actor_id, hello.incarnation, hello.host, hello.pid, hello.worlds
        )
        self.events.add("join", f"actor {hello.actor_id} on {hello.host}")
        return Welcome(
            run_id=self.run_id,
            config=self.config.model_dump(mode="json"),
            actor_index=member.index,
            weights_version=self.weights_version,
            learner_incarnation=self.incarnation,
        )

    def on_chunk(self, header: ChunkHeader, arrays: dict[str, NDArray[Any]], size: int) -> Ack:
        """Check, wait for room, keep; the answer is the acknowledgement."""
        if self.done:
            return self._ack("accepted" if self._is_known(header) else "stale")
        if header.run_id != self.run_id:
            return self._refuse(header, f"run {header.run_id} is not this run ({self.run_id})")
        if self._is_known(header):
            self.dropped["duplicate"] += 1
            return self._ack("duplicate")
        try:
            trajectory = Trajectory.from_arrays(arrays, self.config)
            episodes = [EpisodeRecord.from_dict(episode) for episode in header.episodes]
        except ValueError as error:
            return self._refuse(header, str(error))
        if not self._wait_for_room(size):
            return self._ack("accepted" if self._is_known(header) else "pause")
        member = self.roster.join(
            header.actor_id, header.incarnation, header.host, header.pid, header.worlds
        )
        chunk = Chunk(member.index, header.sequence, trajectory, episodes, size)
        missing = self.roster.accepted(
            header.actor_id,
            header.incarnation,
            header.sequence,
            chunk.samples,
            int(trajectory.version.max()),
            header.timing,
        )
        if missing:
            self.gaps += missing
            self.events.add("gap", f"{missing} chunks of actor {header.actor_id} never came")
        self.rates.add(chunk.samples)
        with self._changed:
            self._queue.append(chunk)
            self._samples += chunk.samples
            self._bytes += size
            self._changed.notify_all()
        return self._ack("accepted")

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        """An actor's liveliness token appeared or vanished."""
        if self.roster.gone(actor_id, incarnation, alive):
            self.events.add("join" if alive else "leave", f"actor {actor_id}")

    # -- the learner's side ------------------------------------------------------------------

    def take(self, samples: int, timeout: float) -> list[Chunk] | None:
        """The oldest chunks that together hold ``samples``, or None after ``timeout`` s.

        Chunks older than ``max_lag`` weight versions are dropped and counted as stale.
        """
        with self._changed:
            self._drop_stale()
            self._changed.wait_for(lambda: self._samples >= samples or self.done, timeout)
            self._drop_stale()
            if self._samples < samples:
                return None
            taken: list[Chunk] = []
            while sum(chunk.samples for chunk in taken) < samples:
                taken.append(self._pop(0))
            self._changed.notify_all()
            return taken

    def take_round(self, actors: int, timeout: float) -> list[Chunk] | None:
        """One chunk of each of ``actors`` actors, ordered by actor; None after ``timeout`` s."""

        def first_of_each() -> dict[int, int]:
            return {c.actor_index: i for i, c in reversed(list(enumerate(self._queue)))}

        with self._changed:
            self._changed.wait_for(lambda: len(first_of_each()) >= actors or self.done, timeout)
            places = first_of_each()
            if len(places) < actors:
                return None
            chunks = {index: self._queue[place] for index, place in places.items()}
            for place in sorted(places.values(), reverse=True):
                self._pop(place)
            self._changed.notify_all()
            return [chunks[index] for index in sorted(chunks)]

    def finish(self) -> None:
        """Tell every actor that asks from now on that the run is done."""
        with self._changed:
            self.done = True
            self._changed.notify_all()

    def waiting(self) -> dict[str, float]:
        """What waits in the queue, for the status."""
        with self._changed:
            return {"chunks": len(self._queue), "megabytes": self._bytes / 1e6}

    # -- small steps -------------------------------------------------------------------------

    def _pop(self, place: int) -> Chunk:
        chunk = self._queue[place]
        del self._queue[place]
        self._samples -= chunk.samples
        self._bytes -= chunk.size
        return chunk

    def _drop_stale(self) -> None:
        limit = self.weights_version - self.config.learner.max_lag
        for place in reversed(range(len(self._queue))):
            if self._queue[place].oldest_version < limit:
                self._pop(place)
                self.dropped["stale"] += 1
                self._changed.notify_all()

    def _has_room(self, size: int) -> bool:
        if self.config.learner.mode == "lockstep":
            return True  # every actor waits for weights by itself
        learner = self.config.learner
        # More than one batch in waiting would only grow old there.
        return self._samples < self.config.ppo.batch_size and (
            not self._queue
            or (
                len(self._queue) < learner.queue_chunks
                and self._bytes + size <= learner.queue_megabytes * 1e6
            )
        )

    def _wait_for_room(self, size: int) -> bool:
        # Half the sender's patience: it hears "pause" before it would send again.
        timeout = 0.5 * self.config.transport.upload_timeout
        with self._changed:
            self._changed.wait_for(lambda: self._has_room(size) or self.done, timeout)
            return self._has_room(size) and not self.done

    def _is_known(self, header: ChunkHeader) -> bool:
        return self.roster.is_known(header.actor_id, header.incarnation, header.sequence)

    def _refuse(self, header: ChunkHeader, reason: str) -> Ack:
        self.dropped["refused"] += 1
        self.events.add("refused", f"chunk {header.sequence} of {header.actor_id}: {reason}")
        return self._ack("refused", reason)

    def _ack(self, status: str, reason: str = "") -> Ack:
        return Ack(
            status=status,
            weights_version=self.weights_version,
            learner_incarnation=self.incarnation,
            reason=reason,
            done=self.done,
        )
