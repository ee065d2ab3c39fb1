"""The learner's side over Zenoh: queryables for hello, uploads, weights, status; membership.

Every kind of question has its own thread, so a stalled upload never delays the others.
"""

from __future__ import annotations

import threading
from typing import Any

import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport.desk import LearnerDesk, to_json
from lndrl.transport.interface import LearnerHandlers, ValidationHandlers
from lndrl.transport.keys import (
    ACTORS,
    ANNOUNCE,
    HELLO,
    OPERATION,
    PING,
    STATUS,
    TESTED,
    VALIDATION,
    WEIGHTS,
)
from lndrl.transport.messages import NO_WEIGHTS, Limits, encode
from lndrl.transport.operation import OperatorHandlers
from lndrl.transport.security.identity import Security
from lndrl.transport.zenoh.intake import CAPACITY, UploadIntake, bytes_of
from lndrl.transport.zenoh.session import (
    ExitGuard,
    UnreachableError,
    ZenohSession,
    open_connecting,
    open_listening,
)

ANNOUNCE_SECONDS = 1.0
JOIN_SECONDS = 10.0
WEIGHTS_THREADS = 8
"""Links that may be slow to take weights before one more has to wait for them."""


class ZenohLearner:
    """See ``LearnerEndpoint``. Opening it occupies the port; raises UserError when it cannot.

    With ``config.router`` it occupies no port but joins the router at ``config.endpoint``, where
    it must be the only learner of its namespace. ``lane``: of the uploads that it takes in itself,
    where other ranks take in the rest.
    """

    def __init__(
        self,
        config: TransportConfig,
        run_id: str = "",
        security: Security | None = None,
        lane: str = "",
    ) -> None:
        self.endpoint = config.endpoint
        self._desk = LearnerDesk(Limits(max_bytes=config.max_message_megabytes * 2**20), run_id)
        self.incarnation = self._desk.incarnation
        self.traffic = self._desk.traffic
        self._uploads = UploadIntake(self._desk, lane, door=True)
        self._news = threading.Event()
        self._entities: list[Any] = []
        self._payload: tuple[str, zenoh.ZBytes] | None = None
        if config.router:
            self._session = _join(config, security or Security("learner"))
        else:
            self._session = open_listening(config.endpoint, config, security)
        self._guard = ExitGuard(self.close)
        # An operator's file may let in less.
        self.largest_message = min(
            self._session.largest_message, config.max_message_megabytes * 2**20
        )

    def start(
        self,
        handlers: LearnerHandlers,
        validation: ValidationHandlers | None = None,
        operator: OperatorHandlers | None = None,
    ) -> None:
        """Begin to answer."""
        self._desk.handlers, self._desk.validation = handlers, validation
        self._desk.operator = operator
        session = self._session
        members = session.zenoh.liveliness().declare_subscriber(
            f"{ACTORS}/**", zenoh.handlers.FifoChannel(CAPACITY), history=True
        )
        self._entities.append(members)
        session.pump("members", members.handler, self._on_member)
        for name, key, take in (
            ("status", STATUS, self._on_status),
            ("announce", ANNOUNCE, self._on_announce),
            ("ping", PING, self._on_ping),
            ("validation", VALIDATION, self._on_validation),
            ("operation", OPERATION, self._on_operation),
            ("hello", HELLO, self._on_hello),
        ):
            queryable = session.zenoh.declare_queryable(key, zenoh.handlers.FifoChannel(CAPACITY))
            self._entities.append(queryable)
            session.pump(name, queryable.handler, take)
        self._entities += self._uploads.start(session)
        weights = session.zenoh.declare_queryable(WEIGHTS, zenoh.handlers.FifoChannel(CAPACITY))
        self._entities.append(weights)
        # A reply waits until its link has taken megabytes in: others must not wait with it.
        for _ in range(WEIGHTS_THREADS):
            session.pump("weights", weights.handler, self._on_weights)
        session.run("announcer", self._announce)

    def publish_weights(self, version: int, blob: bytes, tested: bytes | None = None) -> None:
        """Offer weights; the announcement leaves on another thread."""
        self._desk.put_weights(version, blob, tested)
        self._news.set()

    def publish_status(self, snapshot: dict[str, Any], history: list[dict[str, Any]]) -> None:
        """Offer the status; drops the live copy rather than wait for a slow viewer."""
        self._desk.put_status(snapshot, history)
        self._put(STATUS, to_json(snapshot), zenoh.Priority.DATA_LOW, express=False)

    def finish(self) -> None:
        """Say ``done`` from now on."""
        self._desk.finish()
        self._news.set()

    def close(self) -> None:
        """Stop answering and give the port back."""
        self._guard.release()
        self._uploads.close()
        self._news.set()
        self._session.close()

    def _on_hello(self, query: zenoh.Query) -> None:
        with query:
            query.reply(HELLO, self._desk.answer_hello(bytes_of(query)))

    def _on_ping(self, query: zenoh.Query) -> None:
        with query:
            query.reply(PING, self._desk.answer_ping())

    def _on_validation(self, query: zenoh.Query) -> None:
        with query:
            if str(query.key_expr) == VALIDATION:
                query.reply(VALIDATION, self._desk.answer_validation(bytes_of(query)))

    def _on_operation(self, query: zenoh.Query) -> None:
        with query:
            if str(query.key_expr) == OPERATION:
                query.reply(OPERATION, self._desk.answer_request(bytes_of(query)))

    def _on_weights(self, query: zenoh.Query) -> None:
        with query:
            if str(query.key_expr) != WEIGHTS:
                return  # whoever asks everything there is does not want megabytes
            wanted = bytes_of(query)[:20].decode("ascii", "replace")
            tests = wanted.startswith(TESTED)
            wanted = wanted.removeprefix(TESTED)
            # What is no number asks for no version: its answer would be megabytes for nothing.
            number = int(wanted) if wanted.isdecimal() else NO_WEIGHTS
            version = number if wanted else None
            found = self._desk.tested(number) if tests else self._desk.weights(version)
            if found is None:
                newest = encode(self._desk.announcement())
                query.reply(WEIGHTS, b"", attachment=newest)
                return
            announcement, blob = found
            kept = self._payload
            if kept is None or kept[0] != announcement.digest:
                kept = self._payload = (announcement.digest, zenoh.ZBytes(blob))
            query.reply(WEIGHTS, kept[1], attachment=encode(announcement))

    def _on_announce(self, query: zenoh.Query) -> None:
        with query:
            query.reply(ANNOUNCE, encode(self._desk.announcement()))

    def _on_status(self, query: zenoh.Query) -> None:
        with query:
            status = self._desk.status()
            if status is not None:
                query.reply(STATUS, status)

    def _on_member(self, sample: zenoh.Sample) -> None:
        self._desk.heard_of(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    def _announce(self) -> None:
        # Repeated, because a lost announcement would leave a waiting actor idle for good.
        while not self._session.closing:
            self._news.wait(ANNOUNCE_SECONDS)
            self._news.clear()
            newest = self._desk.announcement()
            if newest.version != NO_WEIGHTS or newest.done:
                self._put(ANNOUNCE, encode(newest), zenoh.Priority.INTERACTIVE_HIGH, express=True)

    def _put(self, key: str, data: bytes, priority: zenoh.Priority, express: bool) -> None:
        if self._session.closing:
            return
        try:
            self._session.zenoh.put(
                key,
                data,
                priority=priority,
                express=express,
                congestion_control=zenoh.CongestionControl.DROP,
            )
        except zenoh.ZError:
            if not self._session.closing:
                raise


def _join(config: TransportConfig, security: Security) -> ZenohSession:
    endpoint, namespace = config.endpoint, config.namespace
    try:
        session = open_connecting(endpoint, config, JOIN_SECONDS, security)
    except UnreachableError:
        raise UserError(
            f"the router at {endpoint} does not answer, or refuses this learner's certificate or"
            " user; start it or correct the address"
        ) from None
    if session.query(PING, timeout=1.0) is not None:
        session.close()
        place = f"in namespace {namespace}" if namespace else "without a namespace"
        raise UserError(
            f"another learner {place} is at the router {endpoint}; give each its own --namespace"
        )
    return session
