"""What each role must not do, tried; what it must, done: over TLS, and over TCP with users."""

from __future__ import annotations

import dataclasses
import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport import (
    PROTOCOL_VERSION,
    Ack,
    ChunkHeader,
    Hello,
    Refusal,
    Security,
    Welcome,
    free_endpoint,
    open_actor,
    open_learner,
    open_viewer,
)
from lndrl.transport.access import (
    EVERY_ACTOR,
    EVERY_UPLOAD,
    RIGHTS,
    ROLES,
    Subject,
    access_control,
    allowed,
    subjects,
)
from lndrl.transport.keys import ACTORS, ANNOUNCE, HELLO, PING, STATUS, UPLOAD, WEIGHTS
from lndrl.transport.security import settings
from lndrl.transport.zenoh_session import (
    UnreachableError,
    ZenohSession,
    open_connecting,
    open_session,
)
from lndrl.version import VERSION
from tests.lndrl.transport.authority import make_certificates

GREETING = Hello("actor-0", "first", "here", 1, 8, VERSION)
PASSWORDS = {"actor": "walks:far", "actor-lab3": "walks near", "dashboard": "sees", "learner": "l"}
ANYTHING = "lndrl/**"
KEYS = (HELLO, EVERY_UPLOAD, WEIGHTS, ANNOUNCE, STATUS, PING, EVERY_ACTOR, ANYTHING)
ACTIONS = ("ask", "answer", "hear", "say", "delete", "appear", "watch")

# Everything that actors and dashboards must not do, key by key; the rest is what they are for.
MUST_NOT: dict[str, dict[str, tuple[str, ...]]] = {
    "actor": {
        "ask": (STATUS, EVERY_ACTOR, ANYTHING),
        "answer": KEYS,
        "hear": (HELLO, EVERY_UPLOAD, WEIGHTS, STATUS, PING, EVERY_ACTOR, ANYTHING),
        "say": KEYS,
        "delete": KEYS,
        "appear": (HELLO, EVERY_UPLOAD, WEIGHTS, ANNOUNCE, STATUS, PING, ANYTHING),
        "watch": KEYS,
    },
    "dashboard": {
        "ask": (HELLO, EVERY_UPLOAD, WEIGHTS, ANNOUNCE, EVERY_ACTOR, ANYTHING),
        "answer": KEYS,
        "hear": (HELLO, EVERY_UPLOAD, WEIGHTS, ANNOUNCE, PING, EVERY_ACTOR, ANYTHING),
        "say": KEYS,
        "delete": KEYS,
        "appear": KEYS,
        "watch": KEYS,
    },
}
CASES = [
    (role, action, key)
    for role, actions in MUST_NOT.items()
    for action, keys in actions.items()
    for key in keys
]


class Handlers:
    """Welcomes everybody and keeps sequences and members."""

    def __init__(self) -> None:
        self.sequences: list[int] = []
        self.members: list[tuple[str, bool]] = []

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        return Welcome("run", {}, 0)

    def on_chunk(self, header: ChunkHeader, arrays: dict, size: int) -> Ack:
        self.sequences.append(header.sequence)
        return Ack("accepted")

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
        self.config = TransportConfig(endpoint=endpoint, lease=2.0, upload_timeout=5.0, **changes)
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
        learner.start(self.handlers)
        return learner

    def session(self, role: str, user: str | None = None, **changes: Any) -> ZenohSession:
        security = self.security(role, user, **changes)
        session = open_connecting(self.config.endpoint, self.config, 10, security)
        self.open.append(session)
        return session

    def close(self) -> None:
        for one in reversed(self.open):
            one.close()


def wait_until(condition: Callable[[], bool], seconds: float = 20.0) -> bool:
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
            return bool({key, name} & {str(answer.ok.key_expr) for answer in answers})

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


def only_ingress(site: Site) -> Path:
    """An overlay that lets everything out, so that what comes in must be stopped on its own."""
    security = site.security("learner", listens=True)
    assert security is not None
    rules = settings(security, listening=True)["access_control"]
    messages = sorted({message for rule in rules["rules"] for message in rule["messages"]})
    rules["rules"].append(
        {
            "id": "all out",
            "permission": "allow",
            "flows": ["egress"],
            "messages": [*messages, "delete"],
            "key_exprs": ["**"],
        }
    )
    for policy in rules["policies"]:
        policy["rules"].append("all out")
    path = site.folder / "overlay.json5"
    path.write_text("// ours, and more\n" + json.dumps({"access_control": rules}))
    return path


@pytest.fixture(scope="module", params=["tls", "users", "tls, ingress alone"])
def guarded(request, tmp_path_factory) -> Iterator[tuple[Watcher, dict[str, zenoh.Session]]]:
    site = Site(request.param.split(",")[0], tmp_path_factory.mktemp("guarded"))
    alone = "ingress" in request.param
    learner = site.learner(**({"overlay": only_ingress(site)} if alone else {}))
    learner.publish_weights(1, b"weights")
    learner.publish_status({"run_id": "run-1"}, [])
    try:
        yield (
            Watcher(learner._session.zenoh),
            {role: site.session(role).zenoh for role in MUST_NOT},
        )
    finally:
        site.close()


@pytest.fixture(scope="module")
def unguarded(tmp_path_factory) -> Iterator[tuple[Watcher, zenoh.Session]]:
    site = Site("open", tmp_path_factory.mktemp("unguarded"))
    try:
        yield Watcher(site.learner()._session.zenoh, 20.0), site.session("actor").zenoh
    finally:
        site.close()


@pytest.fixture(params=["tls", "users", "both"])
def site(request, tmp_path) -> Iterator[Site]:
    made = Site(request.param, tmp_path)
    yield made
    made.close()


@pytest.mark.parametrize(("role", "action", "key"), CASES)
def test_what_a_role_must_not_do_has_no_effect(guarded, role, action, key) -> None:
    watcher, sessions = guarded
    assert not watcher.tries(sessions[role], action, key)


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("key", KEYS)
def test_without_rules_each_of_them_has(unguarded, action, key) -> None:
    """Else the test above would prove nothing."""
    watcher, raw = unguarded
    assert watcher.tries(raw, action, key)


def test_the_tables_together_are_all_there_is() -> None:
    for role in MUST_NOT:
        for action in ACTIONS:
            for key in KEYS:
                forbidden = key in MUST_NOT[role][action]
                assert forbidden != allowed(role, action, key), (role, action, key)
    assert {right.key for right in RIGHTS} <= set(KEYS)


def send(actor: Any, sequence: int) -> None:
    header = ChunkHeader("run", "actor-0", "first", sequence, 1, 1)
    actor.upload(header, {"x": np.zeros(100_000, np.uint8)})


def works(site: Site, learner: Any) -> None:
    """Everything that an actor and a dashboard are for."""
    config = site.config
    actor = open_actor(config.endpoint, config, site.security("actor", "actor-lab3"))
    viewer = open_viewer(config.endpoint, config, site.security("dashboard"))
    site.open += [actor, viewer]
    assert actor.hello(GREETING, 20).learner_incarnation == learner.incarnation
    assert wait_until(lambda: ("actor-0", True) in site.handlers.members)
    send(actor, 1)
    send(actor, 2)
    assert actor.flush(20)
    assert sorted(site.handlers.sequences) == [1, 2]
    learner.publish_weights(7, b"w" * 300_000)
    assert actor.wait_newer(-1, 20)
    assert actor.fetch(timeout=20) == (7, b"w" * 300_000)
    learner.publish_weights(8, b"new")
    # Not from an ack: no chunk was sent since.
    assert wait_until(lambda: actor.newest()[0] == 8)
    learner.publish_status({"run_id": "run-1", "step": 5}, [{"step": 4}])
    assert viewer.status(20)["history"] == [{"step": 4}]
    stream = viewer.stream(silence=0.1)
    assert next(stream) is None
    learner.publish_status({"run_id": "run-1", "step": 6}, [])
    assert next(news for news in stream if news is not None)["step"] == 6
    for role in ROLES:
        answer = json.loads(site.session(role).query(PING, timeout=20).payload.to_bytes())
        assert answer == {
            "program_version": VERSION,
            "protocol": PROTOCOL_VERSION,
            "run_id": "run-1",
        }
    actor.close()
    assert wait_until(lambda: ("actor-0", False) in site.handlers.members)


def test_learner_actor_and_dashboard_work(site) -> None:
    works(site, site.learner())


def test_they_work_in_a_namespace(tmp_path) -> None:
    site = Site("tls", tmp_path, namespace="lab/one")
    try:
        works(site, site.learner())
        elsewhere = site.config.model_copy(update={"namespace": "lab/two"})
        actor = open_actor(elsewhere.endpoint, elsewhere, site.security("actor"))
        site.open.append(actor)
        with pytest.raises(UserError, match="no learner answers"):
            actor.hello(GREETING, 1)
    finally:
        site.close()


def test_strangers_are_refused(site, tmp_path) -> None:
    site.learner()
    strangers: list[dict[str, Any]] = []
    if site.kind != "users":
        strangers.append({"certificates": make_certificates(tmp_path / "other")})
    if site.kind != "tls":
        strangers += [
            {"password": "wrong"},
            {"user": "actor-unknown", "password": "walks:far"},
            {"user": None, "password": None},
        ]
    for changes in strangers:
        security = dataclasses.replace(site.security("actor"), **changes)
        with pytest.raises(UnreachableError):
            open_connecting(site.config.endpoint, site.config, 0.6, security)
    site.session("actor")


def test_a_client_without_certificate_is_refused(tmp_path) -> None:
    site = Site("tls", tmp_path)
    try:
        site.learner()
        client = {
            "mode": "client",
            "scouting/multicast/enabled": False,
            "connect/endpoints": [site.config.endpoint],
            "connect/timeout_ms": 600,
            "transport/link/tls/root_ca_certificate": str(site.certificates / "ca.pem"),
        }
        with pytest.raises(zenoh.ZError):
            open_session(client, 5.0)
        site.session("actor")
    finally:
        site.close()


def test_an_actor_does_not_follow_a_learner_of_another_ca(tmp_path) -> None:
    site = Site("tls", tmp_path)
    try:
        site.learner()
        other = make_certificates(tmp_path / "other")
        actor = open_actor(site.config.endpoint, site.config, Security("actor", other))
        site.open.append(actor)
        with pytest.raises(UserError, match="or it refuses this certificate or user"):
            actor.hello(GREETING, 1)
        assert site.handlers.members == []
    finally:
        site.close()


def test_an_actor_checks_the_name_of_the_learner(tmp_path) -> None:
    site = Site("tls", tmp_path)
    try:
        site.learner()
        endpoint = site.config.endpoint.replace("127.0.0.1", "localhost")
        with pytest.raises(UnreachableError):
            open_connecting(endpoint, site.config, 0.6, site.security("actor"))
    finally:
        site.close()


@pytest.mark.parametrize("kind", ["tls", "users"])
def test_two_runs_share_a_router(kind, tmp_path) -> None:
    """Two learners behind one router: nothing crosses, and a third of the same name is refused."""
    sites = [Site(kind, tmp_path, namespace=name, router=True) for name in ("one", "two")]
    endpoint = sites[0].config.endpoint
    for site in sites:
        site.config = site.config.model_copy(update={"endpoint": endpoint})
    listening = Security("learner", users=sites[0].users)
    if kind == "tls":
        listening = Security("learner", sites[0].certificates)
    roles = subjects(kind == "tls", list(PASSWORDS) if kind == "users" else None)
    router = open_session(
        {
            "mode": "router",
            "scouting/multicast/enabled": False,
            "listen/endpoints": [endpoint],
            **settings(listening, listening=True),
            "access_control": access_control(roles, ("one", "two")),
        },
        20.0,
    )
    try:
        learners = [site.learner() for site in sites]
        for site, learner in zip(sites, learners, strict=True):
            works(site, learner)
        assert [sorted(site.handlers.sequences) for site in sites] == [[1, 2], [1, 2]]
        with pytest.raises(UserError, match="another learner in namespace one is at the router"):
            sites[0].learner()
        watcher = Watcher(sites[0].open[0]._session.zenoh)
        raw = sites[0].session("actor").zenoh
        assert not watcher.tries(raw, "answer", WEIGHTS)
        assert not watcher.tries(raw, "say", ANNOUNCE)
    finally:
        for site in sites:
            site.close()
        router.close()


def test_a_router_that_restarts_is_found_again(tmp_path) -> None:
    site = Site("users", tmp_path, router=True)
    open_router = {
        "mode": "router",
        "scouting/multicast/enabled": False,
        "listen/endpoints": [site.config.endpoint],
        **settings(Security("learner", users=site.users), listening=True),
    }
    router = open_session(open_router, 20.0)
    try:
        site.learner()
        actor = open_actor(site.config.endpoint, site.config, site.security("actor"))
        site.open.append(actor)
        actor.hello(GREETING, 20)
        send(actor, 1)
        assert actor.flush(20)
        router.close()
        send(actor, 2)
        assert not actor.flush(0.5)
        router = open_session(open_router, 20.0)
        assert actor.flush(30)
        assert site.handlers.sequences == [1, 2]
    finally:
        site.close()
        router.close()


def test_a_router_that_is_not_there_is_a_sentence(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("lndrl.transport.zenoh_learner.JOIN_SECONDS", 0.5)
    config = TransportConfig(endpoint=free_endpoint(), router=True)
    with pytest.raises(UserError, match=r"the router at tcp/.* does not answer"):
        open_learner(config)


def test_roles_that_nobody_has_are_left_out() -> None:
    """zenoh would refuse an empty list, and take a missing one for everybody."""
    found = subjects(True, ["actor-1", "actor-2"])
    assert found == {"actor": Subject(("lndrl-actor",), ("actor-1", "actor-2"))}
    rules = access_control(found)
    assert rules["default_permission"] == "deny"
    assert rules["subjects"] == [
        {
            "id": "actor",
            "cert_common_names": ["lndrl-actor"],
            "usernames": ["actor-1", "actor-2"],
        }
    ]
    with pytest.raises(ValueError, match="nothing says who is actor"):
        access_control({"actor": Subject()})
