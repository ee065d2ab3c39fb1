"""The uploads of one lane over Zenoh: taken in by one thread, in the order of ``UploadQueue``."""

from __future__ import annotations

import logging
import time
from typing import Any

import zenoh

from lndrl.transport.desk import LearnerDesk
from lndrl.transport.keys import upload_key
from lndrl.transport.messages import Ack, encode
from lndrl.transport.uploads import UploadQueue
from lndrl.transport.zenoh.session import ZenohSession

CAPACITY = 4096
logger = logging.getLogger(__name__)


class UploadIntake:
    """Answers the uploads that go to ``lane``, by ``desk``."""

    def __init__(self, desk: LearnerDesk, lane: str = "") -> None:
        self._desk = desk
        self._key = f"{upload_key(lane)}/**"
        self._uploads = UploadQueue[zenoh.Query]()

    def start(self, session: ZenohSession) -> Any:
        """Begin; what is returned must be kept for as long as uploads are to be answered."""
        channel: Any = zenoh.handlers.FifoChannel(CAPACITY)
        queryable = session.zenoh.declare_queryable(self._key, channel)
        session.pump("intake", queryable.handler, self._uploads.put)
        session.run("uploads", self._take)
        return queryable

    def close(self) -> None:
        """Answer nothing any more."""
        self._uploads.close()

    def _take(self) -> None:
        while (query := self._uploads.get()) is not None:
            with query:
                try:
                    query.reply(query.key_expr, encode(self._answer(query)))
                except zenoh.ZError:
                    # The actor left or the session closes; an actor that lives sends again.
                    continue
                except Exception:
                    # This thread is the only one that takes uploads in.
                    logger.exception("an upload could not be answered")

    def _answer(self, query: zenoh.Query) -> Ack:
        status, began = "refused", time.thread_time()
        try:
            ack = self._desk.answer_chunk(bytes_of(query))
            status = ack.status
            return ack
        finally:
            # Before the reply, which fails when the sender has left: that must not be cheaper.
            self._uploads.settle(query, status, time.thread_time() - began)


def bytes_of(query: zenoh.Query) -> bytes:
    """What a query says."""
    return query.payload.to_bytes() if query.payload is not None else b""
