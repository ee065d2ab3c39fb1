"""Learner, actor and dashboard at work behind locks, and who is left outside."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport import (
    COUNTS,
    PROTOCOL_VERSION,
    ChunkHeader,
    EvaluatorHello,
    Hello,
    Security,
    ValidationResult,
    ValidationTask,
    free_endpoint,
    open_actor,
    open_evaluator,
    open_learner,
    open_viewer,
)
from lndrl.transport.frames import encode_frame
from lndrl.transport.keys import ANNOUNCE, PING, UPLOAD, WEIGHTS
from lndrl.transport.messages import encode
from lndrl.transport.security.access import (
    ROLES,
    Subject,
    access_control,
    subjects,
)
from lndrl.transport.security.identity import settings
from lndrl.transport.zenoh.session import (
    UnreachableError,
    open_connecting,
    open_session,
)
from lndrl.version import VERSION
from tests.lndrl.transport.security.authority import make_certificates
from tests.lndrl.transport.security.sites import PASSWORDS, PATIENCE, Site, Watcher, wait_until
from tests.lndrl.transport.test_frames import arrays, frame

GREETING = Hello("actor-0", "first", "here", 1, 8, VERSION)


@pytest.fixture(params=["tls", "users", "both"])
def site(request, tmp_path) -> Iterator[Site]:
    made = Site(request.param, tmp_path)
    yield made
    made.close()


def send(actor: Any, sequence: int) -> None:
    header = ChunkHeader("run", "actor-0", "first", sequence, 1, 1)
    actor.upload(header, {"x": np.zeros(100_000, np.uint8)})


def result_of(task: ValidationTask) -> ValidationResult:
    counts = dict(zip(COUNTS, (2, 1, 1, 0, 0, 50), strict=True))
    told = (task.run_id, "evaluator-0", "first", task.learner_incarnation, task.version)
    return ValidationResult(*told, 1.0, counts, counts)


def test_nobody_but_an_evaluator_posts_validation_and_it_does_nothing_else(site) -> None:
    """With a role's certificate or user, through whichever endpoint: what it may not is unheard."""
    learner, config = site.learner(), site.config
    learner.publish_weights(7, b"weights")
    task = ValidationTask("run", {}, 7, learner.incarnation)
    for role in ("actor", "dashboard"):
        liar = open_evaluator(config.endpoint, config, site.security(role))
        site.open.append(liar)
        assert liar.report(result_of(task), 1.0) is None
    assert site.handlers.validated == []
    actor = open_actor(config.endpoint, config, site.security("evaluator"))
    site.open.append(actor)
    with pytest.raises(UserError, match="no learner answers"):
        actor.hello(GREETING, 1)
    header = ChunkHeader("run", "actor-0", "first", 1, 1, 1)
    raw = site.session("evaluator")
    assert raw.query(f"{UPLOAD}/actor-0/first/1", encode(header), timeout=1.0) is None
    assert site.handlers.sequences == []


def works(site: Site, learner: Any) -> None:
    """Everything that an actor and a dashboard are for."""
    config = site.config
    actor = open_actor(config.endpoint, config, site.security("actor", "actor-lab3"))
    viewer = open_viewer(config.endpoint, config, site.security("dashboard"))
    site.open += [actor, viewer]
    assert actor.hello(GREETING, PATIENCE).learner_incarnation == learner.incarnation
    assert wait_until(lambda: ("actor-0", True) in site.handlers.members)
    send(actor, 1)
    send(actor, 2)
    assert actor.flush(PATIENCE)
    assert sorted(site.handlers.sequences) == [1, 2]
    learner.publish_weights(7, b"w" * 300_000)
    assert actor.wait_newer(-1, PATIENCE)
    assert actor.fetch(timeout=PATIENCE) == (7, b"w" * 300_000)
    evaluator = open_evaluator(config.endpoint, config, site.security("evaluator"))
    site.open.append(evaluator)
    task = evaluator.ask(EvaluatorHello("evaluator-0", "first", "here", 1, VERSION), PATIENCE)
    assert (task.version, task.learner_incarnation) == (7, learner.incarnation)
    assert evaluator.fetch(7, PATIENCE) == b"w" * 300_000
    ack = evaluator.report(result_of(task), PATIENCE)
    assert ack is not None and ack.status == "accepted"
    assert site.handlers.validated[-1] == 7
    learner.publish_weights(8, b"new")
    # Not from an ack: no chunk was sent since.
    assert wait_until(lambda: actor.newest()[0] == 8)
    learner.publish_status({"run_id": "run-1", "step": 5}, [{"step": 4}])
    assert viewer.status(PATIENCE)["history"] == [{"step": 4}]
    stream = viewer.stream(silence=0.1)
    assert next(stream) is None
    deadline = time.monotonic() + PATIENCE
    for news in stream:
        if news is not None:
            assert news["step"] == 6
            break
        # Whoever has only just begun to listen may miss the first.
        assert time.monotonic() < deadline
        learner.publish_status({"run_id": "run-1", "step": 6}, [])
    for role in ROLES:
        answer = site.session(role).query(PING, timeout=PATIENCE)
        assert answer is not None
        assert json.loads(answer.payload.to_bytes()) == {
            "program_version": VERSION,
            "protocol": PROTOCOL_VERSION,
            "run_id": "run-1",
        }
    actor.close()
    assert wait_until(lambda: ("actor-0", False) in site.handlers.members)


def test_learner_actor_and_dashboard_work(site) -> None:
    works(site, site.learner())


@pytest.mark.parametrize("role", ["dashboard", "operator", "actor", "evaluator"])
def test_who_may_watch_a_world(role: str, tmp_path) -> None:
    site = Site("tls", tmp_path)
    try:
        site.learner()
        actor = open_actor(site.config.endpoint, site.config, site.security("actor"))
        site.open.append(actor)
        actor.hello(GREETING, timeout=PATIENCE)
        viewer = open_viewer(site.config.endpoint, site.config, site.security(role))
        site.open.append(viewer)
        seat = viewer.watch("actor-0")

        found: list[Any] = []

        def seen() -> bool:
            actor.show(encode_frame(frame(), arrays()))
            found.append(seat.newest())
            return any(each is not None for each in found)

        may = role in ("dashboard", "operator")
        assert wait_until(actor.watched, PATIENCE if may else 0.5) == may
        assert wait_until(seen, PATIENCE if may else 0.5) == may
    finally:
        site.close()


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
            open_session(client, PATIENCE)
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
        PATIENCE,
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
    router = open_session(open_router, PATIENCE)
    try:
        site.learner()
        actor = open_actor(site.config.endpoint, site.config, site.security("actor"))
        site.open.append(actor)
        actor.hello(GREETING, PATIENCE)
        send(actor, 1)
        assert actor.flush(PATIENCE)
        router.close()
        send(actor, 2)
        assert not actor.flush(0.5)
        router = open_session(open_router, PATIENCE)
        assert actor.flush(2 * PATIENCE)
        assert site.handlers.sequences == [1, 2]
    finally:
        site.close()
        router.close()


def test_a_router_that_is_not_there_is_a_sentence(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("lndrl.transport.zenoh.learner.JOIN_SECONDS", 0.5)
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
