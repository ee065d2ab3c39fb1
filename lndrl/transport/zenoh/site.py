"""A site's door: actors of one place talk to it, and it alone talks to the learner.

Questions go through to the learner and answers come back; members appear there under their own
names. Weights are asked for once per version, kept, and handed to everybody here, so that a link
to the learner carries them once (a router would pass each question on: it keeps no answers). Only
one connection is opened, towards the learner, so a site may lie behind NAT.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport.caching import Found, Reply, WeightsCache
from lndrl.transport.interface import LearnerUnreachableError
from lndrl.transport.keys import ACTORS, ANNOUNCE, HELLO, PING, UPLOAD, VALIDATION, WEIGHTS
from lndrl.transport.messages import MessageError, WeightsAnnouncement, decode, encode
from lndrl.transport.security.identity import Security
from lndrl.transport.zenoh.session import (
    ExitGuard,
    UnreachableError,
    ZenohSession,
    cure,
    open_connecting,
    open_listening,
)
from lndrl.transport.zenoh.stage import Window

CAPACITY = 4096
THREADS = 8  # that hand out answers: links within the site that may be slow before others wait
UPLOAD_PATIENCE = 120.0  # s; actors have a patience of their own and send again
PATIENCE = 20.0
WEIGHTS_PATIENCE = 300.0  # of a link so slow that weights take minutes
LOOK = 2.0  # s between two looks at the learner
LOST_AFTER = 4  # looks without an answer after which the connection is opened anew
logger = logging.getLogger(__name__)


class ZenohSite:
    """Serves ``listen`` (of ``config``) for the learner at ``connect`` until closed.

    ``upwards`` and ``security`` protect the two sides; ``say`` hears of what a user should know.
    Raises UserError when the port cannot be had, LearnerUnreachableError when nobody answers.
    """

    def __init__(
        self,
        connect: str,
        config: TransportConfig,
        upwards: Security | None = None,
        security: Security | None = None,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.done = threading.Event()
        self.cache = WeightsCache(self._fetch)
        self._connect, self._config, self._upwards, self._say = connect, config, upwards, say
        self._tokens: dict[str, Any] = {}
        self._windows: dict[str, Window] = {}
        self._entities: list[Any] = []
        self._news: Any = None
        self._heard = time.monotonic()
        self._turn = threading.RLock()  # of whoever changes the session to the learner
        self._work: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._down = open_listening(config.endpoint, config, security or Security("site"))
        try:
            self._up = self._opened(10.0)
        except UnreachableError:
            self._down.close()
            why = cure(upwards or Security("site"))
            raise LearnerUnreachableError(f"no learner answers at {connect}; {why}") from None
        except UserError:
            self._down.close()
            raise
        self._guard = ExitGuard(self.close)
        self._start()

    def members(self) -> int:
        """Actors here."""
        return len(self._tokens)

    def close(self) -> None:
        """Leave; actors go on as soon as another stands here."""
        self._guard.release()
        for _ in range(THREADS):
            self._work.put(None)
        self._down.close()
        self._up.close()

    # -- towards the site --------------------------------------------------------------------

    def _start(self) -> None:
        self._listen_up()
        for number in range(THREADS):
            self._down.run(f"answers-{number}", self._answer)
        for key in (HELLO, f"{UPLOAD}/**", ANNOUNCE, PING, VALIDATION):
            self._serve(key, self._relay)
        self._serve(WEIGHTS, self._on_weights)
        members = self._down.zenoh.liveliness().declare_subscriber(
            f"{ACTORS}/**", zenoh.handlers.FifoChannel(CAPACITY), history=True
        )
        self._down.pump("members", members.handler, self._on_member)
        self._entities.append(members)
        self._down.run("learner-watch", self._watch)

    def _serve(self, key: str, take: Callable[[zenoh.Query], None]) -> None:
        queryable = self._down.zenoh.declare_queryable(key, zenoh.handlers.FifoChannel(CAPACITY))
        self._entities.append(queryable)
        self._down.pump(f"site-{key}", queryable.handler, take)

    def _answer(self) -> None:
        """Hand answers out: not on zenoh's threads, which must not wait for a slow link."""
        while (work := self._work.get()) is not None:
            try:
                work()
            except zenoh.ZError as error:
                logger.debug("an answer found nobody: %s", error)  # who asked has left
            except Exception:
                logger.exception("an answer could not be handed out")

    def _relay(self, query: zenoh.Query) -> None:
        """Ask the learner what was asked here."""
        upload = str(query.key_expr).startswith(UPLOAD)
        priority = zenoh.Priority.DATA if upload else zenoh.Priority.INTERACTIVE_HIGH
        patience = UPLOAD_PATIENCE if upload else PATIENCE

        answers: list[zenoh.Sample] = []

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                answers.append(reply.ok)

        def on_end() -> None:
            self._work.put(lambda: _pass_on(query, answers))

        self._ask(str(query.key_expr), query.payload, patience, priority, on_reply, on_end)

    def _on_weights(self, query: zenoh.Query) -> None:
        if str(query.key_expr) != WEIGHTS:
            query.drop()
            return
        payload = query.payload
        wanted = payload.to_bytes()[:24].decode("ascii", "replace") if payload is not None else ""

        def reply(found: Found | None) -> None:
            self._work.put(lambda: _hand_over(query, found))

        self.cache.ask(wanted, reply)

    # -- towards the learner -----------------------------------------------------------------

    def _opened(self, timeout: float) -> ZenohSession:
        return open_connecting(self._connect, self._config, timeout, self._upwards)

    def _listen_up(self) -> None:
        """Hear announcements over the present session, and let members appear there."""
        self._news = self._up.zenoh.declare_subscriber(ANNOUNCE, zenoh.handlers.RingChannel(1))
        self._up.pump("site-news", self._news.handler, self._on_news)
        for key in list(self._tokens):
            self._appear(key)

    def _on_news(self, sample: zenoh.Sample) -> None:
        news, _ = decode(sample.payload.to_bytes(), WeightsAnnouncement)
        self._heard = time.monotonic()
        self.cache.heard(news)
        with suppress(zenoh.ZError):  # this side is being closed
            self._down.zenoh.put(
                ANNOUNCE,
                encode(news),
                priority=zenoh.Priority.INTERACTIVE_HIGH,
                express=True,
                congestion_control=zenoh.CongestionControl.DROP,
            )
        if news.done:
            self.done.set()

    def _on_member(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        with self._turn:
            self._shut(key)
            token = self._tokens.pop(key, None)
            with suppress(zenoh.ZError):  # its session may be gone
                if token is not None:
                    token.undeclare()
            if sample.kind == zenoh.SampleKind.PUT:
                self._appear(key)

    def _appear(self, key: str) -> None:
        self._tokens[key] = None  # until there is a session, which asks for all
        with suppress(zenoh.ZError):
            self._tokens[key] = self._up.zenoh.liveliness().declare_token(key)
            actor_id = key.removeprefix(f"{ACTORS}/").partition("/")[0]
            self._shut(key)
            self._windows[key] = Window(self._down.zenoh, self._up.zenoh, actor_id, self._work.put)

    def _shut(self, key: str) -> None:
        window = self._windows.pop(key, None)
        if window is not None:
            window.close()

    def _fetch(self, wanted: str, reply: Reply) -> None:
        answers: list[Found] = []

        def on_reply(answer: zenoh.Reply) -> None:
            sample = answer.ok
            if sample is None or sample.attachment is None or answers:
                return
            try:
                news, _ = decode(sample.attachment.to_bytes(), WeightsAnnouncement)
            except MessageError:
                return
            size = len(sample.payload)
            answers.append(Found(news, sample.attachment, sample.payload, size))

        def on_end() -> None:
            self._work.put(lambda: reply(answers[0] if answers else None))

        payload = zenoh.ZBytes(wanted.encode())
        self._ask(WEIGHTS, payload, WEIGHTS_PATIENCE, zenoh.Priority.DATA_LOW, on_reply, on_end)

    def _ask(
        self,
        key: str,
        payload: zenoh.ZBytes | None,
        patience: float,
        priority: zenoh.Priority,
        on_reply: Callable[[zenoh.Reply], None],
        on_end: Callable[[], None],
    ) -> None:
        try:
            self._up.zenoh.get(
                key,
                zenoh.handlers.Callback(on_reply, on_end, indirect=False),
                payload=payload,
                timeout=patience,
                priority=priority,
                congestion_control=zenoh.CongestionControl.BLOCK,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        except zenoh.ZError as error:
            logger.debug("a question could not leave: %s", error)
            on_end()

    def _watch(self) -> None:
        """Open the session to the learner anew where it only looks alive."""
        silent = 0
        while not self._down.closing:
            time.sleep(LOOK)
            alive = time.monotonic() - self._heard < LOOK or self._answers()
            if alive and silent >= LOST_AFTER:
                self._say("the learner answers again")
            silent = 0 if alive else silent + 1
            if silent == LOST_AFTER:
                self._say("no answer from the learner; connecting anew")
            if silent and silent % LOST_AFTER == 0 and not self._down.closing:
                self._renew()

    def _answers(self) -> bool:
        try:
            return self._up.query(PING, timeout=LOOK) is not None
        except zenoh.ZError:
            return False

    def _renew(self) -> None:
        with self._turn:
            try:
                session = self._opened(LOOK)
            except (UnreachableError, UserError) as error:
                logger.debug("still no learner: %s", error)
                return
            former, self._up = self._up, session
            former.close()
            try:
                self._listen_up()
            except zenoh.ZError as error:
                logger.debug("the new session failed at once: %s", error)


def _pass_on(query: zenoh.Query, answers: Sequence[zenoh.Sample]) -> None:
    with query:
        for sample in answers:
            query.reply(sample.key_expr, sample.payload, attachment=sample.attachment)


def _hand_over(query: zenoh.Query, found: Found | None) -> None:
    with query:
        if found is not None:
            query.reply(WEIGHTS, found.payload, attachment=found.attachment)
