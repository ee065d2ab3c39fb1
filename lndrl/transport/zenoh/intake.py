"""The uploads of one lane over Zenoh: taken in by one thread, in the order of ``UploadQueue``."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, field
from typing import Any

import zenoh

from lndrl.transport.desk import LearnerDesk
from lndrl.transport.keys import UPLOAD, upload_key
from lndrl.transport.messages import Ack, encode
from lndrl.transport.uploads import UploadQueue
from lndrl.transport.zenoh.session import ZenohSession

CAPACITY = 4096
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Upload:
    """A query and when it came (monotonic s), as ``UploadQueue`` takes it."""

    query: zenoh.Query
    came: float = field(default_factory=time.monotonic)

    @property
    def key_expr(self) -> Any:
        return self.query.key_expr

    @property
    def payload(self) -> Any:
        return self.query.payload

    def drop(self) -> None:
        self.query.drop()


class UploadIntake:
    """Answers the uploads that go to ``lane``, by ``desk``.

    ``door``: those that go to none as well, of actors that have not heard yet which is theirs.
    """

    def __init__(self, desk: LearnerDesk, lane: str = "", door: bool = False) -> None:
        self._desk = desk
        self._keys = [f"{upload_key(lane)}/**"]
        if lane and door:
            self._keys.append(f"{UPLOAD}/*/*/*")  # of a lane have one word more
        self._uploads = UploadQueue[_Upload]()

    def start(self, session: ZenohSession) -> list[Any]:
        """Begin; what is returned must be kept for as long as uploads are to be answered."""
        entities = []
        for key in self._keys:
            channel: Any = zenoh.handlers.FifoChannel(CAPACITY)
            queryable = session.zenoh.declare_queryable(key, channel)
            session.pump("intake", queryable.handler, self._put)
            entities.append(queryable)
        session.run("uploads", self._take)
        return entities

    def close(self) -> None:
        """Answer nothing any more."""
        self._uploads.close()

    def _put(self, query: zenoh.Query) -> None:
        self._uploads.put(_Upload(query))

    def _take(self) -> None:
        while (upload := self._uploads.get()) is not None:
            query = upload.query
            with query:
                try:
                    query.reply(query.key_expr, encode(self._answer(upload)))
                except zenoh.ZError:
                    # The actor left or the session closes; an actor that lives sends again.
                    continue
                except Exception:
                    # This thread is the only one that takes uploads in.
                    logger.exception("an upload could not be answered")

    def _answer(self, upload: _Upload) -> Ack:
        status, began = "refused", time.thread_time()
        try:
            data = bytes_of(upload.query)
            ack = self._desk.answer_chunk(data)
            status = ack.status
            waited = time.monotonic() - upload.came
            self._desk.traffic.answered(status, len(data), waited)
            return ack
        finally:
            # Before the reply, which fails when the sender has left: that must not be cheaper.
            self._uploads.settle(upload, status, time.thread_time() - began)


def bytes_of(query: zenoh.Query) -> bytes:
    """What a query says."""
    return query.payload.to_bytes() if query.payload is not None else b""
