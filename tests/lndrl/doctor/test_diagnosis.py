"""Every way in which a connection can fail is provoked on loopback, and its sentence read."""

from __future__ import annotations

import json
import socket
import threading
import time
from pathlib import Path
from typing import Any

import pytest
import zenoh

from lndrl.config import TransportConfig
from lndrl.doctor import diagnosis as doctor
from lndrl.doctor import permissions
from lndrl.doctor.diagnosis import Target, diagnose
from lndrl.doctor.permissions import OPERATIONS
from lndrl.doctor.probes import Address, Check, check_name, check_port, parse_address
from lndrl.errors import UserError
from lndrl.transport import (
    free_endpoint,
    open_learner,
)
from lndrl.transport.keys import OPERATION, PING, STATUS, VALIDATION, WEIGHTS
from lndrl.transport.security import certificates
from lndrl.transport.security.access import ROLES
from lndrl.transport.zenoh.learner import ZenohLearner
from lndrl.transport.zenoh.session import open_session
from lndrl.version import VERSION
from tests.lndrl.doctor.examined import (
    ALL_KEYS,
    PATIENCE,
    PONG,
    access,
    examine,
    failed,
    learner,
    mutual,
)


@pytest.mark.parametrize(
    "endpoint",
    ["", "robot:7447", "udp/robot:7447", "tcp/robot", "tcp/robot:0", "tcp/robot:65536",
     "tls/a b:1", "tcp/robot:7447\n", "quic/robot:7447"],
)  # fmt: skip
def test_a_bad_endpoint_is_the_only_check(endpoint: str) -> None:
    checks = list(diagnose(Target(endpoint)))
    assert [(check.name, check.state) for check in checks] == [("endpoint", "failed")]
    assert "tcp/HOST:PORT or tls/HOST:PORT" in checks[0].text


def test_endpoints_are_taken_apart() -> None:
    assert parse_address("tcp/[::1]:7447") == Address("tcp", "::1", 7447)
    assert str(parse_address("tcp/[::1]:7447")) == "tcp/[::1]:7447"
    assert parse_address("tls/robot.lab:1").written("tcp") == "tcp/robot.lab:1"


def test_zenoh_cannot_use_ipv6_addresses_over_tls(folder: Path) -> None:
    """When this one fails, zenoh has learned it and the check may go."""
    checks = examine("tls/[::1]:7447", certificates=folder)
    assert failed(checks) == ["endpoint"] and "host name" in checks["endpoint"].text
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("no IPv6 here")
    address = Address("tls", "::1", int(free_endpoint().rpartition(":")[2]))
    listening = {
        "mode": "router",
        "listen/endpoints": [str(address)],
        **mutual(folder),
        "scouting/delay": 0,
    }
    session = open_session(listening, 30)
    try:
        with pytest.raises(zenoh.ZError):
            doctor._connect(address, Target(str(address), "actor", folder))
    finally:
        session.close()


def test_unknown_names_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    checks = examine("tcp/no.such.host.invalid:7447")
    assert failed(checks) == ["name"]
    assert checks["name"].text.startswith("the host name no.such.host.invalid is unknown")
    assert checks["tcp"].state == checks["session"].state == "skipped"
    never = threading.Event()
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_a, **_k: never.wait(20))
    found = check_name(Address("tcp", "robot", 1), 0.1)
    never.set()
    assert "name service did not answer for robot within 0.1 s" in found.text
    assert check_name(Address("tcp", "::1", 1), 0.1).text == "::1 is an address"


def test_a_port_that_nobody_listens_on_is_told() -> None:
    endpoint = free_endpoint()
    checks = examine(endpoint)
    assert failed(checks) == ["tcp"] and checks["session"].state == "skipped"
    assert checks["tcp"].text.startswith(f"nobody listens on port {endpoint.rpartition(':')[2]}")
    assert "--listen tcp/0.0.0.0:" in checks["tcp"].text


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (TimeoutError(), "10.0.0.9 did not answer within 2 s; it is off, or a firewall"),
        (OSError(113, "No route to host"), "10.0.0.9 cannot be reached (no route to host)"),
        (OSError(101, "Network is unreachable"), "cannot be reached (network is unreachable)"),
    ],
)
def test_hosts_out_of_reach_are_told(
    error: OSError, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise error

    monkeypatch.setattr(socket, "create_connection", refuse)
    found = check_port(Address("tcp", "10.0.0.9", 7447), 2.0)
    assert found.state == "failed" and sentence in found.text


def test_all_is_right_without_protection() -> None:
    with learner() as endpoint:
        checks = examine(endpoint)
    wanted = {one.name for several in OPERATIONS.values() for one in several}
    assert set(checks) == {"endpoint", "name", "tcp", "session", "ping"} | wanted
    assert {check.state for check in checks.values()} == {"ok"}
    assert checks["ping"].text == f"the learner of run first answers, lndrl {VERSION}"


def test_all_roles_are_right_with_certificates(folder: Path, brief: None) -> None:
    roles = {
        "actor": ALL_KEYS[:5],
        "dashboard": [PING, STATUS],
        "evaluator": [PING, WEIGHTS, VALIDATION],
        "site": [*ALL_KEYS[:5], VALIDATION],
        "operator": [PING, STATUS, OPERATION],
        "learner": ["lndrl/**"],
    }
    with learner("tls", mutual(folder) | access(roles)) as endpoint:
        checks = examine(endpoint, certificates=folder)
    assert failed(checks) == []
    for role in ROLES:
        assert checks[f"{role}: certificates"].text.startswith(f"lndrl-{role}, valid for 89 more")
        assert checks[f"{role}: tls"].text.startswith("TLSv1.")
        assert f"lets in certificate lndrl-{role}" in checks[f"{role}: session"].text
        for one in OPERATIONS[role]:
            assert checks[f"{role}: {one.name}"].state == "ok"
    assert checks["learner: publish"].state == "skipped"


def test_a_real_learner_refuses_the_empty_messages_and_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The doctor's questions are answered; the learner only hears of an unreadable upload."""
    config = TransportConfig(endpoint=free_endpoint())
    endpoint = open_learner(config)
    assert isinstance(endpoint, ZenohLearner)
    seen: list[str] = []

    class Handlers:
        def __getattr__(self, name: str) -> Any:
            seen.append(name)
            return lambda *_: None

    def pong(query: zenoh.Query) -> None:
        with query:
            query.reply(PING, json.dumps(PONG))

    try:
        endpoint.start(Handlers())
        endpoint._session.zenoh.declare_queryable(PING, pong)
        checks = examine(config.endpoint, role="actor")
        assert failed(checks) == []
        assert checks["actor: hear announce"].text == "the learner has no weights to announce yet"
        endpoint.publish_weights(1, b"w")
        endpoint.publish_status({}, [])
        checks = examine(config.endpoint, role="actor")
        assert {check.state for check in checks.values()} == {"ok"}
        monkeypatch.setattr(permissions, "HEARING_SECONDS", 0.0)  # only one was published
        assert examine(config.endpoint, role="dashboard")["dashboard: status"].state == "ok"
        # The question for weights must not fetch megabytes of them.
        assert endpoint._payload is None
    finally:
        endpoint.close()
    assert set(seen) == {"on_malformed"}


def test_something_silent_is_no_learner(brief: None) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        checks = examine(f"tcp/127.0.0.1:{silent.getsockname()[1]}", timeout=1.0)
    assert failed(checks) == ["session"]
    assert "nothing came back within 1 s; another program listens" in checks["session"].text


@pytest.fixture
def users(tmp_path: Path) -> dict[str, Any]:
    file = tmp_path / "users"
    file.write_text("actor-lab3:right\ndashboard:secret\n")
    return {"transport/auth/usrpwd/dictionary_file": str(file)}


def test_users_and_passwords_are_told_without_saying_them(
    users: dict[str, Any], brief: None
) -> None:
    lists = {"actor-lab3": [PING, *ALL_KEYS[1:5]]}
    with learner("tcp", users | access(lists, "usernames")) as endpoint:
        right = examine(endpoint, user="actor-lab3", password="right")
        wrong = examine(endpoint, user="actor-lab3", password="wr0ng")
        unknown = examine(endpoint, user="actor-lab4", password="right")
        nobody = examine(endpoint)
    assert failed(right) == [] and right["actor: session"].text.endswith("user actor-lab3")
    assert right["actor: upload"].state == "ok"
    for checks, user in ((wrong, "actor-lab3"), (unknown, "actor-lab4")):
        assert failed(checks) == ["actor: session"]
        text = checks["actor: session"].text
        assert f"user {user} is unknown there or the password is wrong" in text
    assert not any("wr0ng" in check.text for check in wrong.values())
    assert failed(nobody) == ["session"]
    assert "wants a user and a password" in nobody["session"].text
    assert "wr0ng" not in repr(Target(endpoint, password="wr0ng"))


def test_a_learner_without_users_and_users_without_role_are_told(brief: None) -> None:
    with learner() as endpoint:
        checks = examine(endpoint, user="actor", password="x")
        assert failed(checks) == ["actor: session"]
        assert "has no users and refuses user actor" in checks["actor: session"].text
        assert failed(examine(endpoint, user="robot", password="x")) == ["user", "session"]
        mismatch = examine(endpoint, user="actor-1", password="x", role="dashboard")
    assert "has the role actor, not dashboard" in mismatch["dashboard: user"].text


@pytest.mark.parametrize("role", ["actor", "dashboard", "evaluator"])
def test_each_denied_key_is_told(role: str, folder: Path, brief: None) -> None:
    """What is denied fails, and nothing else does."""
    for denied in {one.key for one in OPERATIONS[role]}:
        keys = [key for key in ALL_KEYS if not denied.startswith(key.removesuffix("/**"))]
        with learner("tls", mutual(folder) | access({role: keys})) as endpoint:
            checks = examine(endpoint, certificates=folder, role=role)
        wanted = {f"{role}: {one.name}" for one in OPERATIONS[role] if one.key == denied}
        assert set(failed(checks)) == wanted
        for name in wanted:
            assert checks[name].text.startswith("denied key: nothing came back from lndrl/")
            assert f"certificate lndrl-{role} " in checks[name].text


def test_a_learner_that_publishes_nothing_is_told(brief: None) -> None:
    with learner(answers={STATUS: None}) as endpoint:
        checks = examine(endpoint, role="dashboard")
    assert failed(checks) == ["dashboard: status", "dashboard: hear status"]
    assert "has no status yet" in checks["dashboard: status"].text


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (None, "zenoh answers, but no learner does on lndrl/ping"),
        (b"pong", "what answers on lndrl/ping is no learner"),
        (b"[]", "what answers on lndrl/ping is no learner"),
        (b"{}", "what answers on lndrl/ping is no learner"),
        (json.dumps(PONG | {"program_version": "9.9"}).encode(), "the learner is lndrl 9.9, this"),
        (json.dumps(PONG | {"protocol": 77}).encode(), "the learner speaks protocol 77, this"),
    ],
)
def test_other_learners_and_none_are_told(answer: bytes | None, sentence: str, brief: None) -> None:
    with learner(answers={PING: answer}) as endpoint:
        checks = examine(endpoint, role="dashboard")
    assert failed(checks) == ["dashboard: ping"]
    assert sentence in checks["dashboard: ping"].text


def test_the_namespace_is_asked_in(brief: None) -> None:
    with learner(settings={"namespace": "lab"}) as endpoint:
        assert failed(examine(endpoint, role="dashboard", namespace="lab")) == []
        checks = examine(endpoint, role="dashboard", namespace="other")
    assert failed(checks) == ["dashboard: ping"]
    assert "in the namespace other" in checks["dashboard: ping"].text


@pytest.mark.parametrize("namespace", ["", "a//b", "/a", "a/", "*", "a$*"])
def test_a_bad_namespace_is_told(namespace: str) -> None:
    checks = examine("tcp/127.0.0.1:7447", namespace=namespace)
    assert failed(checks) == ["namespace"] and "is no key" in checks["namespace"].text


def test_a_folder_of_others_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(doctor.os, "listdir", refuse)
    checks = examine("tls/127.0.0.1:7447", certificates=folder)
    assert failed(checks) == ["certificates"]
    assert "cannot be read (permission denied); run as its owner" in checks["certificates"].text


def test_a_link_that_breaks_on_the_way_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def ask(*_: Any) -> None:
        raise zenoh.ZError("closed")

    with learner() as endpoint:
        monkeypatch.setattr(doctor.ZenohSession, "ask", ask)
        assert failed(examine(endpoint)) == ["ping"]
        monkeypatch.setattr(doctor, "_check_ping", lambda *_: (True, Check("ping", "ok", "-")))
        checks = examine(endpoint)
    assert failed(checks) == ["connection"] and "broke off" in checks["connection"].text


def test_no_threads_and_no_sessions_stay(
    folder: Path, standing: str, brief: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    sessions = []
    connect = doctor._connect

    def remember(address: Address, target: Target) -> Any:
        sessions.append(connect(address, target))
        return sessions[-1]

    monkeypatch.setattr(doctor, "_connect", remember)
    before = threading.active_count()
    examine(standing, certificates=folder)
    deadline = time.monotonic() + PATIENCE
    while threading.active_count() > before and time.monotonic() < deadline:
        time.sleep(0.01)
    assert threading.active_count() <= before
    assert [session.closing for session in sessions] == [True] * len(ROLES)


def test_a_program_that_is_no_zenoh_is_told(folder: Path, brief: None) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            while True:
                try:
                    stream, _ = server.accept()
                except OSError:
                    return
                with stream:
                    stream.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        thread = threading.Thread(target=answer)
        thread.start()
        address = f"127.0.0.1:{server.getsockname()[1]}"
        plain = examine(f"tcp/{address}", timeout=2.0)
        tls = examine(f"tls/{address}", certificates=folder, role="actor")
        server.shutdown(socket.SHUT_RDWR)
    thread.join()
    assert failed(plain) == ["session"] and "another program" in plain["session"].text
    assert failed(tls) == ["actor: tls"] and "does not speak TLS" in tls["actor: tls"].text


def test_the_roles_are_those_that_get_certificates() -> None:
    assert set(ROLES) == set(certificates.ROLES)


def test_the_parser_says_what_is_wrong() -> None:
    with pytest.raises(UserError, match="is no endpoint; write tcp/HOST:PORT"):
        parse_address("robot")
