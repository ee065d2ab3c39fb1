"""A session with a robot's router: who is there, what comes in, what goes out.

What comes in is put into one queue by the network's thread, in the order of the wire, and nothing
else is done there; whoever owns the link takes it out.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from queue import Queue
from typing import Any

import zenoh
from zenoh import ext

from lndrl.errors import UserError
from lndrl.robot.link.bridge import BridgeDialect
from lndrl.robot.link.dialect import Dialect, Endpoint, Party, Topic
from lndrl.robot.link.rmw import RmwDialect
from lndrl.robot.messages import NO_HASH, Content, MessageStore
from lndrl.transport.security.identity import Security
from lndrl.transport.zenoh.session import (
    ExitGuard,
    UnreachableError,
    ZenohSession,
    open_session,
)

DIALECTS = ("rmw", "bridge")
_MOST_WAITING = 4096
"""Messages that nobody has taken yet; more are not kept."""
_LISTENS = 1.5
"""s within which whoever is there has been heard of."""


@dataclass(frozen=True)
class Arrival:
    """A message as it came: ``at`` in s of ``time.monotonic``; ``received`` in ns since 1970."""

    topic: Topic
    key: str
    data: bytes
    at: float
    received: int


@dataclass(frozen=True)
class Address:
    """Where a link goes, and how it looks for what is there. ``dialect``, ``distribution``: None
    to find out."""

    endpoint: str
    dialect: str | None = None
    distribution: str | None = None
    domain: int = 0
    overlay: Path | None = None
    """JSON5 file of zenoh settings, applied last."""
    timeout: float = 5.0
    listen: bool = False
    insecure: bool = False


class Publisher:
    """Sends messages of one topic; ``put`` may be called by one thread at a time."""

    def __init__(self, link: Link, topic: Topic, declared: Any, token: str) -> None:
        self.topic = topic
        self._link, self._declared, self._token = link, declared, token
        self._sequence = 0

    def put(self, content: Content) -> bytes:
        """Send ``content``; returns the bytes. Where the link is down it goes nowhere."""
        data = self._link.store.encode(self.topic.type, content)
        self.put_bytes(data)
        return data

    def put_bytes(self, data: bytes) -> None:
        """Send what ``MessageStore.encode`` has made."""
        self._sequence += 1
        attachment = self._link.dialect.attachment(self._token, self._sequence, time.time_ns())
        try:
            self._declared.put(data, attachment=attachment)
        except zenoh.ZError:
            if not self._link.closed:
                raise


class Link:
    """An open session that speaks one dialect; a context manager.

    ``inbox`` holds ``Arrival``s of what is subscribed to, and whatever else is put there;
    ``dropped`` counts what found it full.
    """

    def __init__(
        self, session: ZenohSession, dialect: Dialect, store: MessageStore, node: str, seen: Tokens
    ) -> None:
        self.dialect, self.store = dialect, store
        # No SimpleQueue: in CPython 3.11.7 it waits for ever where a signal's handler outlives the
        # timeout, so Ctrl-C would be heard and not obeyed while the link is silent.
        self.inbox: Queue[Any] = Queue()
        self.dropped = 0
        self._session, self._seen = session, seen
        self.party = Party(str(session.zenoh.info.zid()), node)
        self._number = 0
        self._kept: list[Any] = []  # a token dies with its Python object
        self._guard = ExitGuard(self.close)
        if (token := dialect.node_token(self.party)) is not None:
            self._declare(token)

    @property
    def closed(self) -> bool:
        """Whether it is closed or about to be."""
        return self._session.closing

    def __enter__(self) -> Link:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publisher(self, topic: Topic, urgent: bool = False, waits: bool = False) -> Publisher:
        """Announce ``topic`` and send it from now on.

        ``urgent`` messages wait for no others to travel with. Where the network is too slow a
        message is dropped, unless it ``waits``.
        """
        token = self._token("publisher", topic)
        control = zenoh.CongestionControl
        given: dict[str, Any] = {
            "congestion_control": control.BLOCK if waits else control.DROP,
            "express": urgent,
        }
        key = self.dialect.publish_key(topic)
        if topic.quality.transient_local:
            declared: Any = ext.declare_advanced_publisher(
                self._session.zenoh,
                key,
                cache=ext.CacheConfig(topic.quality.depth),
                publisher_detection=True,
                **given,
            )
        else:
            declared = self._session.zenoh.declare_publisher(key, **given)
        self._kept.append(declared)
        return Publisher(self, topic, declared, token)

    def subscribe(self, topic: Topic, take: Callable[[Arrival], None] | None = None) -> None:
        """Announce that ``topic`` is wanted; messages go to ``inbox``, or to ``take``, which is
        called by the network's thread and must return at once.
        """
        self._token("subscriber", topic)

        def heard(sample: zenoh.Sample) -> None:
            if sample.kind != zenoh.SampleKind.PUT:
                return
            arrival = Arrival(
                topic, str(sample.key_expr), sample.payload.to_bytes(), time.monotonic(),
                time.time_ns(),
            )  # fmt: skip
            if take is not None:
                take(arrival)
            elif self.inbox.qsize() < _MOST_WAITING:
                self.inbox.put(arrival)
            else:
                self.dropped += 1

        # One thread for all: messages of different topics keep their order.
        handler = zenoh.handlers.Callback(heard, indirect=False)
        key = self.dialect.subscribe_key(topic)
        if topic.quality.transient_local:
            history = ext.HistoryConfig(
                detect_late_publishers=True, max_samples=topic.quality.depth
            )
            declared: Any = ext.declare_advanced_subscriber(
                self._session.zenoh, key, handler, history=history
            )
        else:
            declared = self._session.zenoh.declare_subscriber(key, handler)
        self._kept.append(declared)

    def endpoints(self) -> tuple[Endpoint, ...]:
        """Who publishes and subscribes, but for this session."""
        found = map(self.dialect.read_token, self._seen.keys())
        return tuple(each for each in found if each and each.session != self.party.session)

    def connected(self) -> bool:
        """Whether anybody is at the other end."""
        try:
            info = self._session.zenoh.info
            return bool(info.routers_zid() or info.peers_zid())
        except zenoh.ZError:
            return False

    def close(self) -> None:
        """End the session within seconds; what was sent goes out before."""
        self._guard.release()
        self._session.close(before=self._undeclare)

    def _undeclare(self) -> None:
        for each in reversed(self._kept):
            try:
                each.undeclare()
            except zenoh.ZError:
                continue
        self._seen.close()

    def _token(self, kind: Any, topic: Topic) -> str:
        self._number += 1
        token = self.dialect.token(kind, topic, self.party, self._number)
        self._declare(token)
        return token

    def _declare(self, token: str) -> None:
        self._kept.append(self._session.zenoh.liveliness().declare_token(token))


class Tokens:
    """The liveliness tokens that there are, of both dialects."""

    def __init__(self, session: zenoh.Session, domain: int) -> None:
        self._lock = threading.Lock()
        self._keys: set[str] = set()
        expressions = (f"@ros2_lv/{domain}/**", *BridgeDialect.tokens)
        self._subscribers = [
            session.liveliness().declare_subscriber(
                each, zenoh.handlers.Callback(self._hear, indirect=False), history=True
            )
            for each in expressions
        ]

    def keys(self) -> tuple[str, ...]:
        """All that are there now."""
        with self._lock:
            return tuple(self._keys)

    def close(self) -> None:
        """Hear no more."""
        for each in self._subscribers:
            try:
                each.undeclare()
            except zenoh.ZError:
                continue

    def _hear(self, sample: zenoh.Sample) -> None:
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._keys.add(str(sample.key_expr))
            else:
                self._keys.discard(str(sample.key_expr))


def open_link(address: Address, node: str) -> Link:
    """Connect to (or listen at) ``address`` as the node ``node``; finds out what is not given.

    Where nothing tells, it is rmw_zenoh as Jazzy speaks it. Raises UserError where nobody answers,
    and for what is wrong with the address.
    """
    for what, given, known in (("dialect", address.dialect, DIALECTS),):
        if given is not None and given not in known:
            raise UserError(f"{what} {given}: must be one of {', '.join(known)}")
    if address.distribution is not None:
        MessageStore(address.distribution)
    session = _open(address)
    wrapped = ZenohSession(session)
    try:
        seen = Tokens(session, address.domain)
        dialect = address.dialect
        distribution = address.distribution
        if not address.listen and (dialect is None or distribution is None):
            told = _told(seen, address)
            dialect, distribution = dialect or told[0], distribution or told[1]
        store = MessageStore(distribution or "jazzy")
        spoken: Dialect
        if dialect == "bridge":
            spoken = BridgeDialect()
        else:
            spoken = RmwDialect(store, address.domain)
        return Link(wrapped, spoken, store, node, seen)
    except BaseException:
        wrapped.close()
        raise


def _told(seen: Tokens, address: Address) -> tuple[str | None, str | None]:
    """Dialect and distribution, as far as tokens tell."""
    readers: tuple[Dialect, ...] = (
        RmwDialect(MessageStore("jazzy"), address.domain), BridgeDialect(),
    )  # fmt: skip
    until = time.monotonic() + _LISTENS
    settled = 0
    while True:
        keys = seen.keys()
        for reader in readers:
            if address.dialect not in (None, reader.name):
                continue
            if found := [each for each in map(reader.read_token, keys) if each is not None]:
                # Tokens come one by one; a moment later none are missing.
                if len(keys) == settled or time.monotonic() > until:
                    return reader.name, _distribution(found)
                break
        if time.monotonic() > until:
            return None, None
        settled = len(keys)
        time.sleep(0.1)


def _distribution(endpoints: list[Endpoint]) -> str | None:
    """Humble says no hashes; Jazzy and Kilted say the same of all types that are spoken here."""
    hashes = {each.type_hash for each in endpoints if each.type_hash}
    if not hashes:
        return None
    return "humble" if hashes == {NO_HASH} else "jazzy"


def _open(address: Address) -> zenoh.Session:
    # Sides and roles of trainings mean nothing to a robot; the operator's file does.
    security = Security("dashboard", overlay=address.overlay, insecure=address.insecure)
    if address.overlay is None and not address.endpoint.startswith("tcp/"):
        raise UserError(
            f"endpoint {address.endpoint}: needs certificates; give zenoh's settings for them with "
            "--zenoh FILE.json5"
        )
    security.check(address.endpoint, address.listen)
    settings: dict[str, Any] = {
        "adminspace/enabled": False,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "timestamping/enabled": True,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": 2000,
    }
    if address.listen:
        settings |= {
            "mode": "router",
            "listen/endpoints": [address.endpoint],
            "listen/exit_on_failure": True,
        }
    else:
        settings |= {
            "mode": "client",
            "connect/endpoints": [address.endpoint],
            "connect/timeout_ms": max(1, int(address.timeout * 1000)),
            "connect/exit_on_failure": True,
            "connect/retry": {
                "period_init_ms": 200,
                "period_max_ms": 1000,
                "period_increase_factor": 2,
            },
        }
    try:
        return open_session(settings, address.timeout, security)
    except (zenoh.ZError, UnreachableError) as error:
        text = str(error)
    if address.listen:
        raise UserError(
            f"endpoint {address.endpoint}: cannot listen there; stop what listens or choose "
            f"another port ({text[:120]})"
        )
    raise UserError(
        f"no robot answers at {address.endpoint} within {address.timeout:g} s; there must be a "
        "Zenoh router (ros2 run rmw_zenoh_cpp rmw_zenohd, or zenoh-bridge-ros2dds), reachable from "
        "here"
    )
