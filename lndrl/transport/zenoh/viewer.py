"""A dashboard's side over Zenoh: reads the status; an operator's also asks for something."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport.keys import OPERATION, STATUS
from lndrl.transport.messages import encode
from lndrl.transport.operation import Request, sentence_of
from lndrl.transport.security.identity import Security, parse_endpoint
from lndrl.transport.zenoh.config import destination
from lndrl.transport.zenoh.session import (
    ExitGuard,
    UnreachableError,
    ZenohSession,
    cure,
    open_connecting,
)
from lndrl.transport.zenoh.stage import Seat

POLL = 0.05


class ZenohViewer:
    """See ``ViewerEndpoint``. The network is first touched by ``status`` or ``stream``."""

    def __init__(
        self,
        endpoint: str,
        config: TransportConfig | None = None,
        security: Security | None = None,
    ) -> None:
        parse_endpoint(endpoint)
        self._security = security or Security("dashboard")
        self._security.check(endpoint, listening=False)
        self._endpoint = endpoint
        self._destination = destination(endpoint, security)
        self._config = config or TransportConfig(endpoint=endpoint)
        self._session: ZenohSession | None = None
        self._closed = threading.Event()
        self._guard: ExitGuard | None = None

    def status(self, timeout: float = 5.0) -> dict[str, Any]:
        """Snapshot and history."""
        deadline = time.monotonic() + timeout
        reached = False
        while not self._closed.is_set() and (left := deadline - time.monotonic()) > 0:
            try:
                session = self._connect(left)
            except UnreachableError:
                break
            reached = reached or session.connected()
            sample = session.query(STATUS, timeout=left)
            if sample is not None:
                return _object(sample)
            self._closed.wait(min(POLL * 2, left))
        problem = "has no status yet" if reached else "does not answer"
        raise UserError(
            f"the learner at {self._destination} {problem} (waited {timeout:g} s);"
            f" {cure(self._security)}"
        )

    def request(self, action: str, run_id: str, timeout: float = 5.0) -> str:
        """What comes of asking for ``action``, in words."""
        user = f"{self._security.user} at " if self._security.user else ""
        sender = f"{self._security.role} {user}{socket.gethostname()}"[:200]
        question = encode(Request(action, run_id, sender))
        try:
            sample = self._connect(timeout).query(OPERATION, question, timeout)
        except UnreachableError:
            raise UserError(f"the learner at {self._destination} does not answer") from None
        if sample is not None:
            return sentence_of(sample.payload.to_bytes())
        known = self._security.certificates is not None or self._security.user is not None
        if known and self._security.role != "operator":
            raise UserError(
                f"refused: the role {self._security.role} may only look; a {action} takes the"
                " certificate (operator.pem) or a user of the role operator"
            )
        raise UserError(
            f"the learner lets this viewer ask for no {action}, or is of an older version"
        )

    def watch(self, actor_id: str) -> Seat:
        """Have an actor show a world."""
        try:
            return Seat(self._connect(5.0).zenoh, actor_id)
        except UnreachableError:
            raise UserError(f"the learner at {self._destination} does not answer") from None

    def stream(self, silence: float | None = None) -> Iterator[dict[str, Any] | None]:
        """Snapshots as they are published; raises UserError when no learner can be reached."""
        try:
            session = self._connect(5.0)
        except UnreachableError:
            raise UserError(
                f"no learner answers at {self._destination}; {cure(self._security)}"
            ) from None
        with session.zenoh.declare_subscriber(STATUS, zenoh.handlers.RingChannel(1)) as channel:
            quiet_since = time.monotonic()
            while not self._closed.is_set():
                try:
                    sample = channel.try_recv()
                except zenoh.ZError:
                    return
                if sample is not None:
                    quiet_since = time.monotonic()
                    yield _object(sample)
                elif silence is not None and time.monotonic() - quiet_since >= silence:
                    quiet_since = time.monotonic()
                    yield None
                else:
                    self._closed.wait(POLL)

    def close(self) -> None:
        """Leave."""
        self._closed.set()
        if self._guard is not None:
            self._guard.release()
        if self._session is not None:
            self._session.close()

    def _connect(self, timeout: float) -> ZenohSession:
        if self._session is None:
            self._session = open_connecting(self._endpoint, self._config, timeout, self._security)
            self._guard = ExitGuard(self.close)
        return self._session


def _object(sample: zenoh.Sample) -> dict[str, Any]:
    try:
        data = json.loads(sample.payload.to_bytes())
    except ValueError:
        data = None
    if not isinstance(data, dict):
        raise UserError("the learner sent a status that is not JSON; use the same lndrl version")
    return data
