"""An evaluator's side over Zenoh: it asks, fetches and reports, each a question with an answer.

Nothing is published and nothing listened to, so a link that only looks alive shows at the next
question; the session is then opened anew.
"""

from __future__ import annotations

import json
import threading
import time
from typing import Any

import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport.interface import LearnerUnreachableError, WeightsGoneError
from lndrl.transport.keys import PING, TESTED, VALIDATION, WEIGHTS
from lndrl.transport.messages import (
    PROTOCOL_VERSION,
    Ack,
    EvaluatorHello,
    Message,
    MessageError,
    Refusal,
    TooLargeError,
    ValidationResult,
    ValidationTask,
    WeightsAnnouncement,
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
    open_connecting,
)
from lndrl.version import VERSION

PATIENCE = 3.0  # s of one question; after it the session is opened anew
REST = 0.2


class ZenohEvaluator:
    """See ``EvaluatorEndpoint``. The network is first touched by ``ask``."""

    def __init__(
        self,
        endpoint: str,
        config: TransportConfig | None = None,
        security: Security | None = None,
    ) -> None:
        parse_endpoint(endpoint)
        self._security = security or Security("evaluator")
        self._security.check(endpoint, listening=False)
        self._endpoint = endpoint
        self._destination = destination(endpoint, security)
        self._config = config or TransportConfig(endpoint=endpoint)
        self._session: ZenohSession | None = None
        self._closed = threading.Event()
        self._guard: ExitGuard | None = None

    def ask(self, hello: EvaluatorHello, timeout: float = 10.0) -> ValidationTask:
        """Ask what to validate."""
        answer = self._tell(encode(hello), timeout, ValidationTask, Refusal)
        if answer is None:
            raise self._nobody(timeout)
        if isinstance(answer, Refusal):
            raise UserError(f"the learner at {self._destination} refused: {answer.reason}")
        assert isinstance(answer, ValidationTask)
        return answer

    def fetch(self, version: int, timeout: float = 10.0) -> bytes:
        """The weights of ``version``, checked against their digest."""
        deadline = time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0 and not self._closed.is_set():
            sample = self._query(WEIGHTS, f"{TESTED}{version}".encode(), left)
            if sample is None or sample.attachment is None:
                self._check_size()
                self._closed.wait(min(REST, left))
                continue
            found, _ = decode(sample.attachment.to_bytes(), WeightsAnnouncement)
            blob = sample.payload.to_bytes()
            if not blob or found.version != version:
                raise WeightsGoneError(f"version {version} is no longer kept")
            if len(blob) != found.size or digest(blob) != found.digest:
                raise MessageError(f"weights of version {version} arrived damaged")
            return blob
        raise TimeoutError(f"no weights came from {self._destination} within {timeout:g} s")

    def report(self, result: ValidationResult, timeout: float = 10.0) -> Ack | None:
        """Hand over a result."""
        answer = self._tell(encode(result), timeout, Ack, Refusal)
        if isinstance(answer, Refusal):
            return Ack("refused", reason=answer.reason)
        assert answer is None or isinstance(answer, Ack)
        return answer

    def close(self) -> None:
        """Leave."""
        self._closed.set()
        if self._guard is not None:
            self._guard.release()
        if self._session is not None:
            self._session.close()

    def _tell(self, data: bytes, timeout: float, *expected: type[Message]) -> Message | None:
        """The learner's answer; None when none came in ``timeout`` s."""
        deadline = time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0 and not self._closed.is_set():
            sample = self._query(VALIDATION, data, min(PATIENCE, left))
            if sample is None:
                self._closed.wait(min(REST, left))
                continue
            try:
                return decode(sample.payload.to_bytes(), *expected)[0]
            except MessageError as error:
                raise UserError(
                    f"what answers at {self._destination} is no learner of this version ({error})"
                ) from None
        return None

    def _query(self, key: str, data: bytes, timeout: float) -> zenoh.Sample | None:
        """One answer; after none the next question goes over a new session."""
        try:
            session = self._connect(timeout)
        except UnreachableError:
            return None
        try:
            sample = session.query(key, data, timeout)
        except zenoh.ZError:
            sample = None
        if sample is None and not self._answers(session):
            session.close()
            self._session = None
        return sample

    def _connect(self, timeout: float) -> ZenohSession:
        if self._session is None:
            try:
                self._session = open_connecting(
                    self._endpoint, self._config, timeout, self._security
                )
            except UnknownHostError as error:
                # Names may get an address later: who is patient waits.
                raise LearnerUnreachableError(str(error)) from None
            if self._guard is None:
                self._guard = ExitGuard(self.close)
        return self._session

    def _answers(self, session: ZenohSession) -> dict[str, Any]:
        """What the learner says of itself to a ping; empty where none answers."""
        try:
            sample = session.query(PING, timeout=1.0)
            data = json.loads(sample.payload.to_bytes()) if sample is not None else None
        except (zenoh.ZError, ValueError):
            return {}
        return data if isinstance(data, dict) else {}

    def _nobody(self, timeout: float) -> UserError:
        """Why nothing came back: nobody is there, or one of another version, or one that denies."""
        ping = self._answers(self._session) if self._session is not None else {}
        theirs = ping.get("program_version"), ping.get("protocol")
        if ping and theirs != (VERSION, PROTOCOL_VERSION):
            return UserError(
                f"the learner at {self._destination} is lndrl {str(theirs[0])[:40]} (protocol"
                f" {str(theirs[1])[:10]}), this evaluator lndrl {VERSION} (protocol"
                f" {PROTOCOL_VERSION}); install the same"
            )
        denied = " to an evaluator, though it answers pings" if ping else ""
        return LearnerUnreachableError(
            f"no learner answers at {self._destination}{denied} (waited {timeout:g} s);"
            f" {cure(self._security)}"
        )

    def _check_size(self) -> None:
        """Raise TooLargeError where this side cannot receive what the learner would send."""
        session = self._session
        sample = self._query(WEIGHTS, b"9" * 20, PATIENCE)  # no such version: says which is newest
        if session is None or sample is None or sample.attachment is None:
            return
        size = decode(sample.attachment.to_bytes(), WeightsAnnouncement)[0].size
        if size > session.largest_message:
            raise TooLargeError(
                f"weights of {size / 2**20:.3g} MiB cannot be received here; raise"
                f" transport/link/rx/max_message_size ({session.largest_message} bytes) in the"
                " zenoh settings of this evaluator"
            )
