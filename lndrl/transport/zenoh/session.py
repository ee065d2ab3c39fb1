"""Zenoh sessions as this project needs them: explicit configuration, bounded opening and closing.

Facts behind the settings: a default session listens on all interfaces and multicasts; a message
that cannot be queued for ``wait_before_close`` closes the link; implicit shared memory can lose
queries; a thread that is inside Zenoh while the interpreter ends aborts the process.
"""

from __future__ import annotations

import json
import logging
import re
import threading
from collections.abc import Callable, Mapping
from typing import Any

import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.machine.ports import free_port
from lndrl.transport.security.exposure import check_hosts, endpoints_of, read_endpoint
from lndrl.transport.security.identity import Security
from lndrl.transport.security.identity import settings as settings_of
from lndrl.transport.zenoh.config import build

CLOSE_SECONDS = 3.0
SLOWEST_MESSAGE = 300.0
"""s that a message may wait to leave before zenoh closes its link: with zenoh's own 5 s, links that
lose packets are closed while they carry weights. Peers that have frozen are found by the lease."""
logger = logging.getLogger(__name__)


class UnreachableError(Exception):
    """No learner accepted a connection in time."""


class ZenohSession:
    """One open session with the threads that drain its channels.

    Threads only ever wait inside ``recv``, which ends when the session closes.
    """

    def __init__(self, session: zenoh.Session, largest_message: int = 2**30) -> None:
        self.zenoh = session
        self.largest_message = largest_message  # bytes; larger ones are not received
        self._closing = threading.Event()
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()

    @property
    def closing(self) -> bool:
        """Whether the session is closed or about to be."""
        return self._closing.is_set()

    def run(self, name: str, work: Callable[[], None]) -> None:
        """Run ``work`` in a thread that ``close`` waits for."""
        thread = threading.Thread(target=work, name=f"lndrl-{name}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def pump(self, name: str, handler: Any, take: Callable[[Any], None]) -> None:
        """Hand everything that a channel receives to ``take``, in a thread, until closed."""

        def loop() -> None:
            while not self._closing.is_set():
                try:
                    item = handler.recv()
                except zenoh.ZError:
                    return
                try:
                    take(item)
                except Exception:
                    # One bad message or a vanished peer must not silence the channel.
                    if not self._closing.is_set():
                        logger.exception("%s: a message could not be handled", name)

        self.run(name, loop)

    def query(
        self,
        key: str,
        payload: bytes = b"",
        timeout: float = 10.0,
        priority: zenoh.Priority = zenoh.Priority.INTERACTIVE_HIGH,
    ) -> zenoh.Sample | None:
        """One answer to a query, or None when nobody answered; raises ZError when closed."""
        return first_answer(self.ask(key, payload, timeout, priority))

    def ask(
        self,
        key: str,
        payload: bytes,
        timeout: float,
        priority: zenoh.Priority = zenoh.Priority.DATA,
        answers: int = 4,
    ) -> Any:
        """Send a query; its answers arrive on the channel that is returned.

        More of them than ``answers``, unread, would block whatever else the session receives.
        """
        return self.zenoh.get(
            key,
            zenoh.handlers.FifoChannel(answers),
            payload=payload,
            timeout=timeout,
            priority=priority,
            congestion_control=zenoh.CongestionControl.BLOCK,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def connected(self) -> bool:
        """Whether a link to a learner exists now."""
        try:
            return bool(self.zenoh.info.routers_zid())
        except zenoh.ZError:
            return False

    def close(
        self, timeout: float = CLOSE_SECONDS, before: Callable[[], None] | None = None
    ) -> None:
        """Close within ``timeout`` seconds; a session that refuses is left to its thread.

        ``before`` is called first, within the same time: what it asks of zenoh may never return
        where the other end is gone.
        """
        with self._lock:
            if self._closing.is_set():
                return
            self._closing.set()
        thread = threading.Thread(
            target=self._close, args=(before,), name="lndrl-close", daemon=True
        )
        thread.start()
        thread.join(timeout)
        if thread.is_alive():
            logger.warning("a network session did not close within %g s", timeout)
        for worker in self._threads:
            if worker is not threading.current_thread():
                worker.join(0.5)

    def _close(self, before: Callable[[], None] | None) -> None:
        try:
            if before is not None:
                before()
            self.zenoh.close()
        except zenoh.ZError as error:
            logger.debug("closing a session: %s", error)


class ExitGuard:
    """Closes an endpoint when the main thread ends and nobody has closed it.

    Python ends daemon threads by unwinding them, which aborts a process whose thread is inside
    Zenoh. A plain thread is waited for at exit, before that happens.
    """

    def __init__(self, close: Callable[[], None]) -> None:
        self._close = close
        self._released = threading.Event()
        threading.Thread(target=self._watch, name="lndrl-exit-guard").start()

    def release(self) -> None:
        """The endpoint is being closed; the guard is no longer needed."""
        self._released.set()

    def _watch(self) -> None:
        main = threading.main_thread()
        while main.is_alive():
            if self._released.wait(0.2):
                return
        self._close()


def first_answer(channel: Any) -> zenoh.Sample | None:
    """The first positive answer on a query's channel; None when there is none."""
    while True:
        try:
            reply = channel.recv()
        except zenoh.ZError:
            return None
        if reply.ok is not None:
            return reply.ok


def free_endpoint(host: str = "127.0.0.1") -> str:
    """An endpoint on a port that is free at this moment."""
    return f"tcp/{host}:{free_port(host)}"


def open_listening(
    endpoint: str, config: TransportConfig, security: Security | None = None
) -> ZenohSession:
    """The learner's session, a router that listens; raises UserError when it cannot."""
    security = security or Security("learner")
    security.check(endpoint, listening=True)
    settings = {
        **_common(config),
        **settings_of(security, True, config.namespace),
        "mode": "router",
        "listen/endpoints": [endpoint],
        "listen/exit_on_failure": True,
        "transport/unicast/max_sessions": 4096,
    }
    built = build(settings, security)
    if not any(any(endpoints_of(_read(built), side)) for side in ("listen", "connect")):
        raise UserError(f"{security.overlay}: lets the learner listen nowhere; name an endpoint")
    try:
        return _opened(built, 10.0)
    except (zenoh.ZError, UnreachableError) as error:
        text = _plain(error)
    raise UserError(_why_deaf(endpoint, list(endpoints_of(_read(built), "listen")), text))


def _why_deaf(configured: str, listening: list[str], text: str) -> str:
    """Why zenoh, which says ``text``, cannot listen; an operator's file may have it elsewhere."""
    named = [each for each in listening if each in text] or listening
    if len(named) != 1:
        return f"endpoints {', '.join(named) or 'of nowhere'}: cannot listen ({text})"
    endpoint = read_endpoint(named[0])
    host, port = endpoint.host, endpoint.port
    if "in use" in text and port:
        place = "transport.endpoint" if endpoint.text == configured else "the zenoh settings"
        return (
            f"port {port} is in use on {host}; stop the program that listens there or choose"
            f" another port in {place}"
        )
    if "assign requested address" in text:
        return f"endpoint {endpoint.text}: this machine does not have the address {host}"
    if "ermission denied" in text and port:
        return f"endpoint {endpoint.text}: port {port} is not allowed; choose one above 1023"
    return f"endpoint {endpoint.text}: cannot listen ({text})"


def open_connecting(
    endpoint: str, config: TransportConfig, timeout: float, security: Security | None = None
) -> ZenohSession:
    """A client's session; it reconnects by itself later. Raises UnreachableError, UserError."""
    security = security or Security("actor")
    security.check(endpoint, listening=False)
    settings = {
        **_common(config),
        **settings_of(security),
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": max(1, int(timeout * 1000)),
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 200,
            "period_max_ms": 2000,
            "period_increase_factor": 2,
        },
    }
    built = build(settings, security)
    try:
        return _opened(built, timeout)
    except zenoh.ZError as error:
        text = _plain(error)
    if "Unable to connect" in text:
        raise UnreachableError(text)
    raise UserError(f"zenoh cannot open a session for {endpoint} ({text})")


def cure(security: Security) -> str:
    """What to try when nobody answers."""
    usual = "start one there or correct the address"
    if security.certificates is None and security.user is None and security.overlay is None:
        return usual
    return f"{usual}, or it refuses this certificate or user: lndrl doctor says which"


def _common(config: TransportConfig) -> dict[str, Any]:
    return {
        # What runs on a learner, and who, is not for its clients to ask.
        "adminspace/enabled": False,
        **({"namespace": config.namespace} if config.namespace else {}),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        # Neither sent nor taken: what lies in shared memory passes every limit of size, and
        # whoever sent it may still change it.
        "transport/shared_memory/enabled": False,
        "transport/shared_memory/transport_optimization/enabled": False,
        "transport/link/tx/lease": int(config.lease * 1000),
        "transport/link/tx/queue/congestion_control/block/wait_before_close": int(
            SLOWEST_MESSAGE * 1e6
        ),
        "transport/link/rx/max_message_size": config.max_message_megabytes * 2**20,
        # One whole batch. More buys no throughput, and a crowd takes it once per link.
        "transport/link/rx/buffer_size": 2**16,
    }


def _opened(built: zenoh.Config, timeout: float) -> ZenohSession:
    largest = json.loads(built.get_json("transport/link/rx/max_message_size"))
    return ZenohSession(open_built(built, timeout), largest)


def _read(built: zenoh.Config) -> dict[str, Any]:
    return {side: json.loads(built.get_json(side)) for side in ("listen", "connect")}


def _plain(error: Exception) -> str:
    """What zenoh says, without the places in its source."""
    return re.sub(r"\.? at /\S+?:\d+\.?", "", str(error))[:200].rstrip(". ")


def open_session(
    settings: Mapping[str, Any], timeout: float, security: Security | None = None
) -> zenoh.Session:
    """Open a session within about ``timeout`` s; raises ZError, and UnreachableError when late."""
    return open_built(build(settings, security), timeout)


def open_built(built: zenoh.Config, timeout: float) -> zenoh.Session:
    """As ``open_session``, of a configuration that is built; raises UserError, too."""
    result: list[Any] = []
    abandoned = threading.Event()

    def work() -> None:
        try:
            check_hosts(_read(built))
            session = zenoh.open(built)
        except BaseException as error:  # a panic of zenoh's is no Exception
            result.append(error)
            return
        result.append(session)
        if abandoned.is_set():
            session.close()

    thread = threading.Thread(target=work, name="lndrl-open", daemon=True)
    thread.start()
    thread.join(timeout + 0.5)
    if not result:
        abandoned.set()
        raise UnreachableError(f"opening took longer than {timeout:g} s")
    if isinstance(result[0], Exception):
        raise result[0]
    if isinstance(result[0], BaseException):
        raise UserError(f"zenoh fails with these settings ({result[0]})")
    return result[0]
