"""An actor's links and keys without its threads, for one process that stands in for hundreds.

What is asked is answered to a callback on one of zenoh's threads, which must only take a note.
Sending again, windows and patience are left to whoever plays the actors: ``ZenohActor`` is the
endpoint of a real one.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport.interface import LearnerUnreachableError
from lndrl.transport.keys import ACTORS, ANNOUNCE, HELLO, WEIGHTS, upload_key
from lndrl.transport.messages import (
    Ack,
    Hello,
    MessageError,
    Refusal,
    WeightsAnnouncement,
    Welcome,
    decode,
    encode,
)
from lndrl.transport.security.identity import Security
from lndrl.transport.zenoh.session import UnreachableError, ZenohSession, open_connecting

Answered = Callable[[Ack | None], None]
Fetched = Callable[[tuple[int, int] | None], None]

_REST = 0.1  # s between two hellos


class LightActor:
    """The session of one actor; see ``join``.

    Raises UserError for a bad endpoint, LearnerUnreachableError when nobody answers.
    """

    def __init__(
        self,
        endpoint: str,
        config: TransportConfig,
        security: Security | None = None,
        timeout: float = 30.0,
    ) -> None:
        self._endpoint = endpoint
        self._lanes: dict[str, str] = {}  # by actor
        try:
            self._session: ZenohSession = open_connecting(endpoint, config, timeout, security)
        except UnreachableError:
            raise LearnerUnreachableError(f"no learner answers at {endpoint}") from None

    def join(self, hello: Hello, heard: Callable[[int], None], timeout: float = 30.0) -> Welcome:
        """Say hello, appear as a member, and hear of weights: ``heard`` is called with versions.

        Raises UserError when refused, LearnerUnreachableError when no answer comes in time.
        """
        welcome = self._welcome(hello, time.monotonic() + timeout)
        self._lanes[hello.actor_id] = welcome.lane

        def on_news(sample: zenoh.Sample) -> None:
            news, _ = decode(sample.payload.to_bytes(), WeightsAnnouncement)
            heard(news.version)

        session = self._session.zenoh
        self._token = session.liveliness().declare_token(
            f"{ACTORS}/{hello.actor_id}/{hello.incarnation}"
        )
        self._news = session.declare_subscriber(
            ANNOUNCE, zenoh.handlers.Callback(on_news, indirect=False)
        )
        return welcome

    def upload(
        self, hello: Hello, sequence: int, payload: bytes, patience: float, answered: Answered
    ) -> None:
        """Send a chunk; ``answered`` is called once, with None where no answer came in time."""
        lane = upload_key(self._lanes.get(hello.actor_id, ""))
        key = f"{lane}/{hello.actor_id}/{hello.incarnation}/{sequence}"
        found: list[Ack] = []

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None and not found:
                try:
                    found.append(decode(reply.ok.payload.to_bytes(), Ack)[0])
                except MessageError:
                    return
                answered(found[0])

        def on_end() -> None:
            if not found:
                answered(None)

        self._get(key, payload, patience, zenoh.Priority.DATA, on_reply, on_end)

    def fetch(self, patience: float, fetched: Fetched) -> None:
        """Ask for the newest weights; ``fetched`` hears (version, bytes), None if none came."""
        found: list[tuple[int, int]] = []

        def on_reply(reply: zenoh.Reply) -> None:
            sample = reply.ok
            if sample is not None and sample.attachment is not None and not found:
                news, _ = decode(sample.attachment.to_bytes(), WeightsAnnouncement)
                found.append((news.version, len(sample.payload)))
                fetched(found[0])

        def on_end() -> None:
            if not found:
                fetched(None)

        self._get(WEIGHTS, b"", patience, zenoh.Priority.DATA_LOW, on_reply, on_end)

    def close(self) -> None:
        """Leave."""
        self._session.close()

    def _get(
        self,
        key: str,
        payload: bytes,
        patience: float,
        priority: zenoh.Priority,
        on_reply: Callable[[zenoh.Reply], None],
        on_end: Callable[[], None],
    ) -> None:
        self._session.zenoh.get(
            key,
            zenoh.handlers.Callback(on_reply, on_end, indirect=False),
            payload=payload,
            timeout=patience,
            priority=priority,
            congestion_control=zenoh.CongestionControl.BLOCK,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def _welcome(self, hello: Hello, deadline: float) -> Welcome:
        while (left := deadline - time.monotonic()) > 0:
            sample = self._session.query(HELLO, encode(hello), left)
            if sample is None:
                time.sleep(min(_REST, left))
                continue
            answer, _ = decode(sample.payload.to_bytes(), Welcome, Refusal)
            if isinstance(answer, Refusal):
                raise UserError(f"the learner at {self._endpoint} refused: {answer.reason}")
            assert isinstance(answer, Welcome)
            return answer
        raise LearnerUnreachableError(f"no learner answers at {self._endpoint}")
