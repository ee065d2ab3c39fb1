"""An actor's side over Zenoh: uploads as queries that are answered when the learner has taken them.

As many threads as the window is wide each carry one chunk at a time: send, wait for the ack, send
the same sequence again when none comes. Unless the learner is merely busy, several failures in a
row make the session be opened anew, which also heals links that only look alive.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping
from typing import Any

import zenoh
from numpy.typing import NDArray

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport.bookkeeper import Bookkeeper
from lndrl.transport.interface import LearnerUnreachableError, WeightsGoneError
from lndrl.transport.keys import ACTORS, ANNOUNCE, HELLO, WEIGHTS, upload_key
from lndrl.transport.ledger import Entry
from lndrl.transport.messages import (
    Ack,
    ChunkHeader,
    Hello,
    Message,
    MessageError,
    Refusal,
    TooLargeError,
    WeightsAnnouncement,
    Welcome,
    decode,
    digest,
    encode,
)
from lndrl.transport.security.exposure import UnknownHostError
from lndrl.transport.security.identity import Security, parse_endpoint
from lndrl.transport.zenoh.config import destination
from lndrl.transport.zenoh.session import (
    ExitGuard,
    UnreachableError,
    ZenohSession,
    cure,
    first_answer,
    open_connecting,
)
from lndrl.transport.zenoh.stage import Stage

REST = 0.2
FAILURES_UNTIL_REOPEN = 3
REOPEN_SECONDS = 2.0
logger = logging.getLogger(__name__)


class ZenohActor(Bookkeeper):
    """See ``ActorEndpoint``. The network is first touched by ``hello``."""

    def __init__(
        self,
        endpoint: str,
        config: TransportConfig | None = None,
        security: Security | None = None,
    ) -> None:
        parse_endpoint(endpoint)
        self._security = security or Security("actor")
        self._security.check(endpoint, listening=False)
        self._endpoint = endpoint
        self._destination = destination(endpoint, security)
        self._config = config or TransportConfig(endpoint=endpoint)
        super().__init__(self._config.upload_window)
        self._session: ZenohSession | None = None
        self._entities: list[Any] = []
        self._hello: Hello | None = None
        self._lane = ""
        self._turn = threading.Lock()
        self._opening = threading.RLock()
        self._failures = 0
        self._carriers: list[threading.Thread] = []
        self._guard: ExitGuard | None = None
        self._stage: Stage | None = None
        self._told: Any = None  # the channel of an answer that nobody waits for

    def hello(self, hello: Hello, timeout: float = 10.0) -> Welcome:
        """Introduce the actor."""
        deadline = time.monotonic() + timeout
        if self._guard is None:
            self._guard = ExitGuard(self.close)
        answer = self._first_contact(encode(hello), deadline)
        if answer is None:
            raise LearnerUnreachableError(
                f"no learner answers at {self._destination} (waited {timeout:g} s);"
                f" {cure(self._security)}"
            )
        if isinstance(answer, Refusal):
            raise UserError(f"the learner at {self._destination} refused: {answer.reason}")
        assert isinstance(answer, Welcome)
        with self._opening:
            self._hello, self._lane = hello, answer.lane
            if self._session is not None:
                self._join(self._session)
        self.ledger.welcomed(answer)
        self._start_carriers()
        return answer

    def tell(self, hello: Hello) -> None:
        """Say what is new about this actor; whether it arrives does not matter."""
        session = self._session
        if session is None or session.closing:
            return
        try:
            self._told = session.ask(HELLO, encode(hello), REOPEN_SECONDS)
        except zenoh.ZError as error:
            logger.debug("news could not leave: %s", error)

    def upload(
        self,
        header: ChunkHeader,
        arrays: Mapping[str, NDArray[Any]],
        timeout: float | None = None,
    ) -> None:
        """Send a chunk in the background; blocks while the window is full."""
        entry = self._written(header, arrays, self._config.max_message_megabytes)
        self.ledger.wait_room(timeout)
        self.ledger.add(entry)

    def adopt(self, config: TransportConfig) -> None:
        """Wait for acknowledgements, send and receive as the run's configuration says."""
        before = self._config.max_message_megabytes
        taken = ("upload_timeout", "upload_window", "max_message_megabytes")
        self._config = self._config.model_copy(update={k: getattr(config, k) for k in taken})
        self.ledger.widen(self._config.upload_window)
        self._start_carriers()
        if self._config.max_message_megabytes > before:
            # What a session receives is settled when it opens; larger weights would never come.
            with self._opening:
                self._renew(self._session)

    def watched(self) -> bool:
        """Whether somebody watches this actor's world."""
        stage = self._stage
        return stage is not None and stage.watched

    def show(self, frame: bytes) -> None:
        """Send a frame to whoever watches."""
        stage = self._stage
        if stage is not None:
            stage.show(frame)

    def flush(self, timeout: float) -> bool:
        """Wait until every chunk is settled."""
        return self.ledger.wait_settled(timeout)

    def fetch(self, version: int | None = None, timeout: float = 10.0) -> tuple[int, bytes]:
        """Weights as (version, blob), checked against their digest."""
        deadline = time.monotonic() + timeout
        payload = b"" if version is None else str(version).encode()
        failures = 0
        while not self.ledger.closed() and (left := deadline - time.monotonic()) > 0:
            session = self._session
            # Acknowledgements and news go before megabytes on the same link.
            sample = self._ask(WEIGHTS, payload, left, zenoh.Priority.DATA_LOW)
            if sample is None or sample.attachment is None:
                failures += 1
                self._check_size()
                if failures % FAILURES_UNTIL_REOPEN == 0:
                    self._reopen(session)
                time.sleep(min(REST, left))
                continue
            found, _ = decode(sample.attachment.to_bytes(), WeightsAnnouncement)
            blob = sample.payload.to_bytes()
            if blob and version in (None, found.version):
                if len(blob) != found.size or digest(blob) != found.digest:
                    raise MessageError(f"weights of version {found.version} arrived damaged")
                return found.version, blob
            if version is not None and version < found.version:
                raise WeightsGoneError(f"version {version} is no longer kept")
            time.sleep(min(REST / 4, left))
        raise TimeoutError(f"no weights came from {self._destination} within {timeout:g} s")

    def _check_size(self) -> None:
        """Raise TooLargeError where the newest weights are larger than what is received here."""
        session, sample = self._session, self._ask(ANNOUNCE, b"", REOPEN_SECONDS)
        if session is None or sample is None:
            return
        size = decode(sample.payload.to_bytes(), WeightsAnnouncement)[0].size
        if size > session.largest_message:
            raise TooLargeError(
                f"weights of {size / 2**20:.3g} MiB cannot be received here; raise"
                f" transport/link/rx/max_message_size ({session.largest_message} bytes) in the"
                " zenoh settings of this actor"
            )

    def close(self) -> None:
        """Leave."""
        self.ledger.close()
        if self._guard is not None:
            self._guard.release()
        session = self._session
        if session is not None:
            session.close()
        for thread in self._carriers:
            thread.join(REOPEN_SECONDS + 1.0)

    def _first_contact(self, data: bytes, deadline: float) -> Message | None:
        while not self.ledger.closed() and (left := deadline - time.monotonic()) > 0:
            if self._session is None:
                with self._opening:
                    try:
                        if self._session is None:
                            self._session = self._connect(left)
                    except UnreachableError:
                        return None
                    except UnknownHostError as error:
                        # At once, and yet names may get an address later: who is patient waits.
                        raise LearnerUnreachableError(str(error)) from None
                continue
            sample = self._ask(HELLO, data, left)
            if sample is not None:
                try:
                    answer, _ = decode(sample.payload.to_bytes(), Welcome, Refusal)
                except MessageError as error:
                    raise UserError(
                        f"what answers at {self._destination} is no learner of this version"
                        f" ({error})"
                    ) from None
                return answer
            time.sleep(min(REST, left))
        return None

    def _connect(self, timeout: float) -> ZenohSession:
        return open_connecting(self._endpoint, self._config, timeout, self._security)

    def _ask(
        self,
        key: str,
        payload: bytes,
        timeout: float,
        priority: zenoh.Priority = zenoh.Priority.INTERACTIVE_HIGH,
    ) -> zenoh.Sample | None:
        session = self._session
        if session is None or session.closing:
            return None
        try:
            return session.query(key, payload, timeout, priority)
        except zenoh.ZError:
            return None

    def _join(self, session: ZenohSession) -> None:
        """Show up as a member and listen to announcements; once per session."""
        if self._entities or self._hello is None:
            return
        key = f"{ACTORS}/{self._hello.actor_id}/{self._hello.incarnation}"
        self._entities.append(session.zenoh.liveliness().declare_token(key))
        news = session.zenoh.declare_subscriber(ANNOUNCE, zenoh.handlers.RingChannel(1))
        self._entities.append(news)
        session.pump("news", news.handler, self._on_news)
        self._stage = Stage(session.zenoh, self._hello.actor_id)

    def _on_news(self, sample: zenoh.Sample) -> None:
        news, _ = decode(sample.payload.to_bytes(), WeightsAnnouncement)
        self.ledger.heard(news.version, news.learner_incarnation, news.done)

    def _start_carriers(self) -> None:
        while len(self._carriers) < self._config.upload_window:
            thread = threading.Thread(target=self._carry, name="lndrl-upload", daemon=True)
            self._carriers.append(thread)
            thread.start()

    def _carry(self) -> None:
        while True:
            channel = None
            # Taking and sending under one lock keeps chunks in order of their sequence.
            with self._turn:
                entry = self.ledger.take()
                if entry is None:
                    return
                session = self._session
                try:
                    if session is not None and not session.closing:
                        channel = self._send(session, entry)
                except zenoh.ZError as error:
                    logger.debug("an upload could not leave: %s", error)
            ack = self._receive(channel)
            if ack is not None:
                self._failures = 0
                self.ledger.settle(entry, ack)
                continue
            self.ledger.postpone(entry, REST)
            self._failures += 1
            if self._failures >= FAILURES_UNTIL_REOPEN:
                self._reopen(session, entry)

    def _send(self, session: ZenohSession, entry: Entry) -> Any:
        place = f"{entry.actor_id}/{entry.incarnation}/{entry.sequence}"
        return session.ask(
            f"{upload_key(self._lane)}/{place}", entry.payload, self._config.upload_timeout
        )

    def _receive(self, channel: Any) -> Ack | None:
        if channel is None:
            return None
        sample = first_answer(channel)
        if sample is None:
            return None
        try:
            return decode(sample.payload.to_bytes(), Ack)[0]
        except MessageError as error:
            logger.warning("an ack could not be read: %s", error)
            return None

    def _reopen(self, failed: ZenohSession | None, entry: Entry | None = None) -> None:
        with self._opening:
            if self.ledger.closed() or self._session is not failed:
                return
            if self._ask(ANNOUNCE, b"", REOPEN_SECONDS) is not None:
                # The learner lives and is only busy; a new session would not help.
                self._failures = 0
                if entry is not None:
                    logger.warning(
                        "an upload of %.3g MiB has had no answer %d times, though the learner"
                        " answers other questions: it is very busy, or something on the way drops"
                        " messages of that size (rx/max_message_size of a router)",
                        *(len(entry.payload) / 2**20, FAILURES_UNTIL_REOPEN),
                    )
                return
            logger.warning("no answer from %s; connecting anew", self._destination)
            self._renew(failed)

    def _renew(self, former: ZenohSession | None) -> None:
        """A new session in place of ``former``; whoever calls holds ``_opening``."""
        if former is not None:
            former.close()
        self._entities = []
        self._stage = None
        self._session = None
        try:
            session = self._connect(REOPEN_SECONDS)
        except UnreachableError:
            return
        except UserError as error:
            # Certificates that are being renewed may be missing for a moment.
            logger.warning("%s", error)
            return
        self._session = session
        self._failures = 0
        if self.ledger.closed():
            session.close()
            return
        try:
            self._join(session)
        except zenoh.ZError as error:
            logger.warning("the new session failed at once: %s", error)
