"""A learner behind locks, and whoever comes to it."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zenoh

from lndrl.config import TransportConfig
from lndrl.transport import (
    Ack,
    ChunkHeader,
    EvaluatorHello,
    Hello,
    Refusal,
    Security,
    ValidationResult,
    ValidationTask,
    Welcome,
    free_endpoint,
    open_learner,
)
from lndrl.transport.keys import ACTORS, STATUS, UPLOAD
from lndrl.transport.operation import Granted, Request
from lndrl.transport.security.access import EVERY_ACTOR, EVERY_UPLOAD
from lndrl.transport.zenoh.session import (
    ZenohSession,
    open_connecting,
)
from tests.lndrl.transport.security.authority import make_certificates

PATIENCE = 60.0  # s, for machines with much else to do
ANYTHING = "lndrl/**"
PASSWORDS = {
    "actor": "walks:far",
    "actor-lab3": "walks near",
    "dashboard": "sees",
    "evaluator": "tests",
    "site": "stands between",
    "operator": "decides",
    "learner": "l",
}


class Handlers:
    """Welcomes everybody and keeps sequences and members."""

    def __init__(self) -> None:
        self.sequences: list[int] = []
        self.members: list[tuple[str, bool]] = []
        self.validated: list[int] = []
        self.requests: list[Request] = []

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        return Welcome("run", {}, 0)

    def on_chunk(self, header: ChunkHeader, arrays: dict, size: int) -> Ack:
        self.sequences.append(header.sequence)
        return Ack("accepted")

    def on_evaluator(self, hello: EvaluatorHello) -> ValidationTask | Refusal:
        return ValidationTask("run", {}, 7)

    def on_validation(self, result: ValidationResult) -> Ack:
        self.validated.append(result.version)
        return Ack("accepted")

    def on_request(self, request: Request) -> Granted | Refusal:
        self.requests.append(request)
        return Granted(f"a {request.action} it is")

    def on_malformed(self, reason: str) -> None:
        pass

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        self.members.append((actor_id, alive))


class Site:
    """A learner and whoever comes to it; ``kind`` tls, users, both or open."""

    def __init__(self, kind: str, folder: Path, **changes: Any) -> None:
        self.kind, self.folder = kind, folder
        self.certificates = folder / "certs"
        self.users = folder / "users"
        if not self.users.exists():
            make_certificates(self.certificates)
            self.users.touch(0o600)
            lines = [f"{user}:{password}\n" for user, password in PASSWORDS.items()]
            self.users.write_text("".join(lines))
        address = free_endpoint().removeprefix("tcp")
        endpoint = ("tls" if kind in ("tls", "both") else "tcp") + address
        self.config = TransportConfig(endpoint=endpoint, lease=10.0, upload_timeout=20.0, **changes)
        self.handlers = Handlers()
        self.open: list[Any] = []

    def security(
        self, role: str, user: str | None = None, listens: bool = False, **changes: Any
    ) -> Security | None:
        if self.kind == "open":
            return None
        folder = self.certificates if self.kind in ("tls", "both") else None
        names = self.kind in ("users", "both")
        if listens and not self.config.router:
            return Security(role, folder, users=self.users if names else None, **changes)
        user = user or role
        login = (user, PASSWORDS.get(user)) if names else (None, None)
        return dataclasses.replace(Security(role, folder, *login), **changes)

    def learner(self, **changes: Any) -> Any:
        learner = open_learner(
            self.config, "run-1", self.security("learner", listens=True, **changes)
        )
        self.open.append(learner)
        learner.start(self.handlers, self.handlers, self.handlers)
        return learner

    def session(self, role: str, user: str | None = None, **changes: Any) -> ZenohSession:
        security = self.security(role, user, **changes)
        session = open_connecting(self.config.endpoint, self.config, PATIENCE, security)
        self.open.append(session)
        return session

    def close(self) -> None:
        for one in reversed(self.open):
            one.close()


def wait_until(condition: Callable[[], bool], seconds: float = PATIENCE) -> bool:
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return condition()


class Watcher:
    """The learner's own session, which no rule touches, sees what came in.

    ``patience`` is how many s an effect may take; it ends early when there is one.
    """

    def __init__(self, session: zenoh.Session, patience: float = 0.04) -> None:
        self.session, self.patience = session, patience
        self.heard: list[tuple[str, bytes]] = []
        self.asked: list[bytes] = []
        self._entities = [
            session.declare_subscriber("**", self._hear),
            session.declare_queryable("**", self._answer),
        ]

    def _hear(self, sample: zenoh.Sample) -> None:
        self.heard.append((str(sample.kind), sample.payload.to_bytes()))

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            self.asked.append(query.payload.to_bytes() if query.payload else b"")

    def _seen(self, look: Callable[[], bool]) -> bool:
        deadline = time.monotonic() + self.patience
        while not (found := look()) and time.monotonic() < deadline:
            time.sleep(0.01)
        return found

    def tries(self, raw: zenoh.Session, action: str, key: str) -> bool:
        """Whether ``action`` on ``key`` had an effect anywhere."""
        return getattr(self, action)(raw, key, concrete(key))

    def ask(self, raw: zenoh.Session, key: str, name: str) -> bool:
        mark = f"question {time.monotonic_ns()}".encode()
        answers = list(raw.get(key, payload=mark, timeout=1.0, target=zenoh.QueryTarget.ALL))
        return any(answer.ok is not None for answer in answers) or self._seen(
            lambda: mark in self.asked
        )

    def answer(self, raw: zenoh.Session, key: str, name: str) -> bool:
        asked = threading.Event()

        def lie(query: zenoh.Query) -> None:
            asked.set()
            with query:
                query.reply(query.key_expr, b"forged")

        def look() -> bool:
            answers = list(self.session.get(name, timeout=1.0, target=zenoh.QueryTarget.ALL))
            return asked.is_set() or any(
                answer.ok is not None and answer.ok.payload.to_bytes() == b"forged"
                for answer in answers
            )

        with raw.declare_queryable(key, lie):
            return self._seen(look)

    def hear(self, raw: zenoh.Session, key: str, name: str) -> bool:
        mark, heard = f"news {time.monotonic_ns()}".encode(), []

        def look() -> bool:
            self.session.put(name, mark)
            return mark in heard

        with raw.declare_subscriber(key, lambda sample: heard.append(sample.payload.to_bytes())):
            return self._seen(look)

    def say(self, raw: zenoh.Session, key: str, name: str) -> bool:
        mark = f"said {time.monotonic_ns()}".encode()
        raw.put(name, mark)
        raw.put(key, mark)
        return self._seen(lambda: any(data == mark for _, data in list(self.heard)))

    def delete(self, raw: zenoh.Session, key: str, name: str) -> bool:
        self.heard.clear()
        raw.delete(name)
        raw.delete(key)
        return self._seen(lambda: any("DELETE" in kind for kind, _ in list(self.heard)))

    def appear(self, raw: zenoh.Session, key: str, name: str) -> bool:
        def look() -> bool:
            answers = self.session.liveliness().get("**")
            return bool({key, name} & {str(answer.ok.key_expr) for answer in answers if answer.ok})

        tokens = [raw.liveliness().declare_token(token) for token in {key, name}]
        found = self._seen(look)
        for token in tokens:
            token.undeclare()
        return found

    def watch(self, raw: zenoh.Session, key: str, name: str) -> bool:
        seen: list[str] = []

        def look() -> bool:
            answers = list(raw.liveliness().get(key, timeout=1.0))
            return name in seen or any(answer.ok is not None for answer in answers)

        with (
            self.session.liveliness().declare_token(name),
            raw.liveliness().declare_subscriber(
                key, lambda sample: seen.append(str(sample.key_expr)), history=True
            ),
        ):
            return self._seen(look)


def concrete(key: str) -> str:
    """A key without wildcards that ``key`` includes."""
    names = {EVERY_UPLOAD: f"{UPLOAD}/a/b/1", EVERY_ACTOR: f"{ACTORS}/a/b", ANYTHING: STATUS}
    return names.get(key, key)
