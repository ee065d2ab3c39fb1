"""The uploads of one lane over Zenoh: taken in by one thread, in the order of ``UploadQueue``."""

from __future__ import annotations

import logging
import time
from typing import Any

import zenoh

from lndrl.transport.desk import LearnerDesk
from lndrl.transport.keys import UPLOAD, upload_key
from lndrl.transport.messages import Ack, encode
from lndrl.transport.uploads import UploadQueue
from lndrl.transport.zenoh.session import ZenohSession

CAPACITY = 4096
logger = logging.getLogger(__name__)


class UploadIntake:
    """Answers the uploads that go to ``lane``, by ``desk``.

    ``door``: those that go to none as well, of actors that have not heard yet which is theirs.
    """

    def __init__(self, desk: LearnerDesk, lane: str = "", door: bool = False) -> None:
        self._desk = desk
        self._keys = [f"{upload_key(lane)}/**"]
        if lane and door:
            self._keys.append(f"{UPLOAD}/*/*/*")  # of a lane have one word more
        self._uploads = UploadQueue[zenoh.Query]()

    def start(self, session: ZenohSession) -> list[Any]:
        """Begin; what is returned must be kept for as long as uploads are to be answered."""
        entities = []
        for key in self._keys:
            channel: Any = zenoh.handlers.FifoChannel(CAPACITY)
            queryable = session.zenoh.declare_queryable(key, channel)
            session.pump("intake", queryable.handler, self._uploads.put)
            entities.append(queryable)
        session.run("uploads", self._take)
        return entities

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
