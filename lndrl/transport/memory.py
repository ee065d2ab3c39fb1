"""The transport within one process: same interface and rules, no threads of its own.

An upload calls the learner's handler on the actor's thread, through the same bytes as on the
wire. So actors and learner run in one thread for ``--serial`` and under a debugger.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from numpy.typing import NDArray

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport.bookkeeper import Bookkeeper
from lndrl.transport.desk import LearnerDesk, to_json
from lndrl.transport.frames import WorldFrame, decode_frame
from lndrl.transport.interface import (
    LearnerHandlers,
    LearnerUnreachableError,
    ValidationHandlers,
    WeightsGoneError,
)
from lndrl.transport.messages import (
    Ack,
    ChunkHeader,
    EvaluatorHello,
    Hello,
    Limits,
    Refusal,
    ValidationResult,
    ValidationTask,
    WeightsAnnouncement,
    Welcome,
    decode,
    encode,
)
from lndrl.transport.operation import OperatorHandlers, Request, sentence_of

POLL = 0.01


class MemoryNetwork:
    """Where endpoints of one process find each other; one learner at a time."""

    def __init__(self, config: TransportConfig | None = None) -> None:
        self.config = config or TransportConfig()
        self.limits = Limits(max_bytes=self.config.max_message_megabytes * 2**20)
        self.desk: LearnerDesk | None = None
        self.actors: list[MemoryActor] = []
        self.viewers: list[queue.Queue[bytes]] = []
        self.watchers: list[MemoryWatching] = []
        self.chunk_lock = threading.Lock()
        self.hello_lock = threading.Lock()

    def learner(self, run_id: str = "") -> MemoryLearner:
        """A learner; the endpoint answers from ``start`` until ``close``."""
        return MemoryLearner(self, run_id)

    def actor(self) -> MemoryActor:
        """An actor."""
        return MemoryActor(self)

    def evaluator(self) -> MemoryEvaluator:
        """An evaluator."""
        return MemoryEvaluator(self)

    def viewer(self) -> MemoryViewer:
        """A dashboard."""
        return MemoryViewer(self)


class MemoryLearner:
    """The learner's side; see ``LearnerEndpoint``."""

    def __init__(self, network: MemoryNetwork, run_id: str) -> None:
        self.run_id = run_id
        self._network = network
        self._desk = LearnerDesk(network.limits)
        self.incarnation = self._desk.incarnation
        self.largest_message = network.limits.max_bytes

    def start(
        self,
        handlers: LearnerHandlers,
        validation: ValidationHandlers | None = None,
        operator: OperatorHandlers | None = None,
    ) -> None:
        """Begin to answer; actors that are already there are reported as members."""
        if self._network.desk is not None:
            raise UserError("this process already has a learner; close it first")
        self._desk.handlers, self._desk.validation = handlers, validation
        self._desk.operator = operator
        self._network.desk = self._desk
        for actor in list(self._network.actors):
            actor.report(alive=True)

    def publish_weights(self, version: int, blob: bytes, tested: bytes | None = None) -> None:
        """Offer weights."""
        self._announce(self._desk.put_weights(version, blob, tested))

    def publish_status(self, snapshot: dict[str, Any], history: list[dict[str, Any]]) -> None:
        """Offer the status."""
        self._desk.put_status(snapshot, history)
        if self._network.desk is self._desk:
            for mailbox in list(self._network.viewers):
                mailbox.put(to_json(snapshot))

    def finish(self) -> None:
        """Say ``done`` from now on."""
        self._announce(self._desk.finish())

    def close(self) -> None:
        """Stop answering."""
        if self._network.desk is self._desk:
            self._network.desk = None

    def _announce(self, news: WeightsAnnouncement) -> None:
        if self._network.desk is self._desk:
            for actor in list(self._network.actors):
                actor.ledger.heard(news.version, news.learner_incarnation, news.done)


class MemoryActor(Bookkeeper):
    """An actor's side; see ``ActorEndpoint``."""

    def __init__(self, network: MemoryNetwork) -> None:
        super().__init__(network.config.upload_window)
        self._network = network
        self._hello: Hello | None = None

    def hello(self, hello: Hello, timeout: float = 10.0) -> Welcome:
        """Introduce the actor."""
        desk = self._wait(lambda: self._network.desk, timeout)
        if desk is None:
            raise LearnerUnreachableError(f"no learner runs in this process (waited {timeout:g} s)")
        with self._network.hello_lock:
            answer, _ = decode(desk.answer_hello(encode(hello)), Welcome, Refusal)
        if isinstance(answer, Refusal):
            raise UserError(f"the learner refused this actor: {answer.reason}")
        assert isinstance(answer, Welcome)
        self._hello = hello
        self.ledger.welcomed(answer)
        if self not in self._network.actors:
            self._network.actors.append(self)
        self.report(alive=True)
        self._send()
        return answer

    def tell(self, hello: Hello) -> None:
        """Say what is new about this actor."""
        if self._network.desk is not None:
            with self._network.hello_lock:
                self._network.desk.answer_hello(encode(hello))

    def upload(
        self,
        header: ChunkHeader,
        arrays: Mapping[str, NDArray[Any]],
        timeout: float | None = None,
    ) -> None:
        """Hand a chunk to the learner's handler, on this thread."""
        entry = self._written(header, arrays, self._network.config.max_message_megabytes)
        deadline = None if timeout is None else time.monotonic() + timeout
        while not self.ledger.has_room():
            if deadline is not None and time.monotonic() >= deadline:
                raise TimeoutError(f"no upload was settled within {timeout:g} s")
            self._send()
            if not self.ledger.has_room():
                time.sleep(POLL)
        self.ledger.add(entry)
        self._send()

    def adopt(self, config: TransportConfig) -> None:
        """Have as many uploads unsettled as the run's configuration says."""
        self.ledger.widen(config.upload_window)

    def watched(self) -> bool:
        """Whether somebody watches this actor's world."""
        return bool(self._network.watchers) and any(self._watchers())

    def show(self, frame: bytes) -> None:
        """Leave a frame where those who watch find it."""
        for watcher in self._watchers():
            watcher.frame = frame

    def _watchers(self) -> list[MemoryWatching]:
        actor_id = self._hello.actor_id if self._hello is not None else ""
        return [each for each in self._network.watchers if each.actor_id == actor_id]

    def flush(self, timeout: float) -> bool:
        """Send what waits."""
        deadline = time.monotonic() + timeout
        while True:
            self._send()
            if self.ledger.wait_settled(0.0):
                return True
            if time.monotonic() >= deadline or self.ledger.closed() or self.ledger.needs_hello():
                return False
            time.sleep(POLL)

    def fetch(self, version: int | None = None, timeout: float = 10.0) -> tuple[int, bytes]:
        """Weights as (version, blob)."""
        found = self._wait(lambda: self._look(version), timeout)
        if found is None:
            raise TimeoutError(f"no weights came within {timeout:g} s")
        return found[0].version, found[1]

    def close(self) -> None:
        """Leave."""
        if not self.ledger.closed():
            self.ledger.close()
            if self in self._network.actors:
                self._network.actors.remove(self)
                self.report(alive=False)

    def report(self, alive: bool) -> None:
        """Tell the learner's handlers that this actor came or went."""
        desk = self._network.desk
        if desk is not None and desk.handlers is not None and self._hello is not None:
            desk.handlers.on_member(self._hello.actor_id, self._hello.incarnation, alive)

    def _look(self, version: int | None) -> tuple[WeightsAnnouncement, bytes] | None:
        desk = self._network.desk
        if desk is None:
            return None
        found = desk.weights(version)
        if found is None and version is not None and version < desk.announcement().version:
            raise WeightsGoneError(f"version {version} is no longer kept")
        return found

    def _send(self) -> None:
        while (entry := self.ledger.take(block=False)) is not None:
            desk = self._network.desk
            if desk is None:
                self.ledger.postpone(entry, POLL)
                return
            with self._network.chunk_lock:
                ack = desk.answer_chunk(entry.payload)
            self.ledger.settle(entry, ack)

    def _wait(self, look: Callable[[], Any], timeout: float) -> Any:
        deadline = time.monotonic() + timeout
        while (
            (found := look()) is None and time.monotonic() < deadline and not self.ledger.closed()
        ):
            time.sleep(POLL)
        return found


class MemoryEvaluator:
    """An evaluator's side; see ``EvaluatorEndpoint``. Never waits: all are in one process."""

    def __init__(self, network: MemoryNetwork) -> None:
        self._network = network

    def ask(self, hello: EvaluatorHello, timeout: float = 10.0) -> ValidationTask:
        """Ask what to validate."""
        desk = self._network.desk
        if desk is None:
            raise LearnerUnreachableError("no learner runs in this process")
        answer, _ = decode(desk.answer_validation(encode(hello)), ValidationTask, Refusal)
        if isinstance(answer, Refusal):
            raise UserError(f"the learner refused this evaluator: {answer.reason}")
        assert isinstance(answer, ValidationTask)
        return answer

    def fetch(self, version: int, timeout: float = 10.0) -> bytes:
        """The weights of ``version``."""
        found = self._network.desk.tested(version) if self._network.desk else None
        if found is None:
            raise WeightsGoneError(f"version {version} is no longer kept")
        return found[1]

    def report(self, result: ValidationResult, timeout: float = 10.0) -> Ack | None:
        """Hand over a result."""
        desk = self._network.desk
        if desk is None:
            return None
        answer, _ = decode(desk.answer_validation(encode(result)), Ack, Refusal)
        if isinstance(answer, Refusal):
            return Ack("refused", reason=answer.reason)
        assert isinstance(answer, Ack)
        return answer

    def close(self) -> None:
        """Leave."""


class MemoryWatching:
    """See ``frames.Watching``."""

    def __init__(self, network: MemoryNetwork, actor_id: str) -> None:
        self.actor_id = actor_id
        self.frame: bytes | None = None
        self._network = network
        network.watchers.append(self)

    def newest(self) -> tuple[WorldFrame, dict[str, NDArray[Any]]] | None:
        """The newest frame since the last call."""
        frame, self.frame = self.frame, None
        return None if frame is None else decode_frame(frame)

    def close(self) -> None:
        """Watch no longer."""
        if self in self._network.watchers:
            self._network.watchers.remove(self)


class MemoryViewer:
    """A dashboard's side; see ``ViewerEndpoint``."""

    def __init__(self, network: MemoryNetwork) -> None:
        self._network = network
        self._closed = threading.Event()

    def status(self, timeout: float = 5.0) -> dict[str, Any]:
        """Snapshot and history."""
        deadline = time.monotonic() + timeout
        while True:
            desk = self._network.desk
            data = desk.status() if desk is not None else None
            if data is not None:
                return json.loads(data)
            if time.monotonic() >= deadline or self._closed.is_set():
                raise UserError(f"no learner in this process gave a status within {timeout:g} s")
            time.sleep(POLL)

    def request(self, action: str, run_id: str, timeout: float = 5.0) -> str:
        """Ask the learner of this process for something."""
        desk = self._network.desk
        if desk is None:
            raise UserError("no learner runs in this process")
        return sentence_of(desk.answer_request(encode(Request(action, run_id, "this process"))))

    def watch(self, actor_id: str) -> MemoryWatching:
        """Watch an actor's world."""
        return MemoryWatching(self._network, actor_id)

    def stream(self, silence: float | None = None) -> Iterator[dict[str, Any] | None]:
        """Snapshots as they are published."""
        mailbox: queue.Queue[bytes] = queue.Queue()
        self._network.viewers.append(mailbox)
        quiet_since = time.monotonic()
        try:
            while not self._closed.is_set():
                try:
                    data = mailbox.get(timeout=0.1 if silence is None else min(0.1, silence))
                except queue.Empty:
                    if silence is not None and time.monotonic() - quiet_since >= silence:
                        quiet_since = time.monotonic()
                        yield None
                    continue
                quiet_since = time.monotonic()
                yield json.loads(data)
        finally:
            self._network.viewers.remove(mailbox)

    def close(self) -> None:
        """Leave."""
        self._closed.set()
