"""The side of a learner's other ranks over Zenoh: each takes in the uploads of its lane.

A rank joins the session of rank 0, which routes between it and the actors, or the router that
rank 0 has joined. Hellos, weights and status are rank 0's alone.
"""

from __future__ import annotations

from typing import Any

import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport.desk import LearnerDesk
from lndrl.transport.interface import LearnerHandlers
from lndrl.transport.keys import ACTORS
from lndrl.transport.messages import Limits
from lndrl.transport.security.identity import Security
from lndrl.transport.zenoh.intake import CAPACITY, UploadIntake
from lndrl.transport.zenoh.session import ExitGuard, UnreachableError, open_connecting

JOIN_SECONDS = 10.0


class ZenohRank:
    """See ``RankEndpoint``. Opening it connects to ``config.endpoint``; raises UserError."""

    def __init__(
        self,
        config: TransportConfig,
        lane: str,
        incarnation: str,
        security: Security | None = None,
    ) -> None:
        limits = Limits(max_bytes=config.max_message_megabytes * 2**20)
        self._desk = LearnerDesk(limits, incarnation=incarnation)
        self.traffic = self._desk.traffic
        self._uploads = UploadIntake(self._desk, lane)
        self._entities: list[Any] = []
        try:
            self._session = open_connecting(
                config.endpoint, config, JOIN_SECONDS, security or Security("learner")
            )
        except UnreachableError:
            raise UserError(
                f"rank 0 does not let this rank in at {config.endpoint}; actors and the other "
                "ranks must reach the address that it listens at, with its certificates"
            ) from None
        self._guard = ExitGuard(self.close)
        self.largest_message = min(self._session.largest_message, limits.max_bytes)

    def start(self, handlers: LearnerHandlers) -> None:
        """Begin to answer the uploads of this lane, and to hear which actors live."""
        self._desk.handlers = handlers
        members = self._session.zenoh.liveliness().declare_subscriber(
            f"{ACTORS}/**", zenoh.handlers.FifoChannel(CAPACITY), history=True
        )
        self._entities.append(members)
        self._session.pump("members", members.handler, self._on_member)
        self._entities += self._uploads.start(self._session)

    def note_version(self, version: int) -> None:
        """From now on acknowledgements tell of these weights, which rank 0 has."""
        self._desk.note_version(version)

    def finish(self) -> None:
        """Say ``done`` from now on."""
        self._desk.finish()

    def close(self) -> None:
        """Stop answering; can be called twice."""
        self._guard.release()
        self._uploads.close()
        self._session.close()

    def _on_member(self, sample: zenoh.Sample) -> None:
        self._desk.heard_of(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)
