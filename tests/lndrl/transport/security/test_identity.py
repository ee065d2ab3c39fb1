"""What is refused before anything connects, in one sentence that keeps secrets."""

from __future__ import annotations

import json
import logging
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import settings as settings_of_hypothesis
from hypothesis import strategies as st

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport import Security, free_endpoint, open_actor, open_learner
from lndrl.transport.security.exposure import check_exposure
from lndrl.transport.security.identity import (
    check_private,
    is_loopback,
    parse_endpoint,
    read_password,
    read_users,
    settings,
)
from lndrl.transport.zenoh import deployment
from lndrl.transport.zenoh.config import build, merged
from lndrl.transport.zenoh.learner import ZenohLearner
from lndrl.transport.zenoh.overlay import read_overlay
from tests.lndrl.transport.security.authority import make_certificates

ROOT = Path(__file__).resolve().parents[4]
SECRET = "walks-on-water"
TCP, TLS = "tcp/127.0.0.1:7447", "tls/127.0.0.1:7447"


@pytest.fixture(scope="module")
def certificates(tmp_path_factory) -> Path:
    return make_certificates(tmp_path_factory.mktemp("ca") / "certs")


def private(path: Path, text: str | bytes) -> Path:
    path.touch(0o600)
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def refused(security: Security, endpoint: str = TLS, listening: bool = False) -> str:
    with pytest.raises(UserError) as caught:
        security.check(endpoint, listening)
    assert SECRET not in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("listening", [True, False])
@pytest.mark.parametrize("role", ["learner", "actor", "dashboard"])
def test_certificates_that_are_there_pass(certificates, role, listening) -> None:
    Security(role, certificates).check(TLS, listening)
    found = settings(Security(role, certificates), listening)
    sides = {key.split("/")[-1] for key in found if "private_key" in key}
    assert sides == {"connect_private_key"} | ({"listen_private_key"} if listening else set())
    assert found["transport/link/tls/enable_mtls"] is True
    assert found["transport/link/tls/verify_name_on_connect"] is True
    assert found["transport/link/protocols"] == ["tls"]
    assert ("access_control" in found) == listening


def test_certificates_that_are_not_there_are_sentences(tmp_path) -> None:
    assert "no such folder of certificates" in refused(Security("actor", tmp_path / "none"))
    folder = make_certificates(tmp_path / "certs")
    (folder / "actor.key").chmod(0o640)
    message = refused(Security("actor", folder))
    assert f"{folder}/actor.key: others on this machine may read it; chmod 600" in message
    Security("dashboard", folder).check(TLS, False)
    for name in ("actor.key", "actor.pem", "ca.pem"):
        (folder / name).unlink()
        assert f"{folder}/{name}: no such file" in refused(Security("actor", folder))
    (folder / "dashboard.pem").write_bytes(b"\xff\xfe")
    assert "ca.pem: no such file" in refused(Security("dashboard", folder))


def test_certificates_and_endpoint_must_agree(certificates) -> None:
    message = refused(Security("learner", certificates), TCP, listening=True)
    assert message.endswith(f"in {certificates}; write tls/127.0.0.1:7447")
    assert "needs certificates" in refused(Security("actor"), TLS)
    with pytest.raises(UserError, match="needs certificates"):
        open_learner(TransportConfig(endpoint=TLS))


@pytest.mark.parametrize(
    ("security", "sentence"),
    [
        (Security("actor", user="actor"), "user actor has no password; put it in a file"),
        (Security("actor", password=SECRET), "there is a password but no user"),
        (Security("actor", user="dashboard", password=SECRET), "'dashboard' cannot be used"),
        (Security("actor", user="actors", password=SECRET), "called actor or actor-NAME"),
        (Security("actor", user="actor-", password=SECRET), "called actor or actor-NAME"),
        (Security("actor", user="actor-a b", password=SECRET), "called actor or actor-NAME"),
        (Security("actor", users=Path("u")), "u: a users file belongs to the side that listens"),
    ],
)
def test_logins_that_cannot_work_are_sentences(security, sentence) -> None:
    assert sentence in refused(security, TCP)


def test_a_login_of_the_role_passes() -> None:
    for user in ("actor", "actor-lab3", "actor-lab-3.b"):
        Security("actor", user=user, password=SECRET).check(TCP, False)


def test_users_are_read_as_zenoh_reads_them(tmp_path) -> None:
    text = f"actor:{SECRET}\n\n actor-b : p:q \r\ndashboard:é =;\n"
    users = read_users(private(tmp_path / "users", text))
    assert users == {"actor": SECRET, "actor-b": "p:q", "dashboard": "é =;"}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "names no user"),
        ("\n \n", "names no user"),
        (f"actor:{SECRET}\n{SECRET}\n", "line 2: must be user:password"),
        (f"actor:{SECRET}\ndashboard:\n", "line 2: must be user:password"),
        (f"actor:{SECRET}\x00\n", "line 1: must be user:password"),
        (f":{SECRET}\n", "line 1: the user's name must be learner, actor, dashboard"),
        (f"# actor:{SECRET}\n", "line 1: the user's name must be"),
        (f"\ufeffactor:{SECRET}\n", "line 1: the user's name must be"),
        (f"actors:{SECRET}\n", "line 1: the user's name must be"),
        (f"root:{SECRET}\n", "line 1: the user's name must be"),
        (f"actor-a b:{SECRET}\n", "line 1: the user's name must be"),
        (f"actor:{SECRET}\nactor:{SECRET}2\n", "line 2: user actor has a line above already"),
        (b"actor:\xff\n", "is not text in UTF-8"),
    ],
)
def test_odd_users_files_are_sentences(text, sentence, tmp_path) -> None:
    path = private(tmp_path / "users", text)
    message = refused(Security("learner", users=path), TCP, listening=True)
    assert message.startswith(str(path)) and sentence in message


@settings_of_hypothesis(deadline=None)
@given(st.text(max_size=60))
def test_any_users_file_is_read_or_refused(tmp_path_factory, text) -> None:
    path = private(tmp_path_factory.getbasetemp() / "any-users", text.encode("utf-8", "replace"))
    try:
        users = read_users(path)
    except UserError as error:
        assert "\n" not in str(error).removeprefix(str(path))
    else:
        assert users and all(users.values())


def test_files_of_secrets_are_for_their_owner(tmp_path) -> None:
    for read in (read_users, read_password, check_private):
        path = private(tmp_path / read.__name__, f"actor:{SECRET}")
        path.chmod(0o604)
        with pytest.raises(UserError, match="others on this machine may read it"):
            read(path)
    with pytest.raises(UserError, match="no such file"):
        read_users(tmp_path / "none")
    with pytest.raises(UserError, match="cannot be read"):
        read_users(tmp_path)


def test_a_password_file_holds_one_line(tmp_path) -> None:
    assert read_password(private(tmp_path / "one", f"\n{SECRET} \n")) == SECRET
    for number, text in enumerate(("", "\n", f"{SECRET}\nmore\n")):
        path = private(tmp_path / str(number), text)
        with pytest.raises(UserError, match="must hold the password on one line") as caught:
            read_password(path)
        assert SECRET not in str(caught.value)


@pytest.mark.parametrize(
    ("endpoint", "parts"),
    [
        ("tcp/127.0.0.1:7447", ("tcp", "127.0.0.1", 7447)),
        ("tls/learner.example:1", ("tls", "learner.example", 1)),
        ("tls/[::1]:65535", ("tls", "[::1]", 65535)),
    ],
)
def test_endpoints(endpoint, parts) -> None:
    assert parse_endpoint(endpoint) == parts


@pytest.mark.parametrize(
    ("host", "loopback"),
    [
        ("127.0.0.1", True), ("127.9.9.9", True), ("[::1]", True), ("localhost", True),
        ("0.0.0.0", False), ("[::]", False), ("10.0.0.1", False), ("[fe80::1]", False),
        ("learner.example", False), ("127.0.0.1.example", False), ("", False),
    ],
)  # fmt: skip
def test_loopback(host, loopback) -> None:
    assert is_loopback(host) is loopback


@pytest.mark.parametrize(
    "endpoint", ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/10.0.0.1:7447", "tcp/somewhere:7447"]
)
def test_listening_beyond_loopback_wants_protection(endpoint, tmp_path) -> None:
    config = TransportConfig(endpoint=endpoint)
    users = private(tmp_path / "users", f"actor:{SECRET}")
    for security in (None, Security("learner"), Security("learner", users=users)):
        with pytest.raises(UserError, match="is open to other machines") as found:
            open_learner(config, security=security)
        assert endpoint in str(found.value)
        assert "--certs FOLDER with tls/" in str(found.value) and "--insecure" in str(found.value)


def test_insecure_and_certificates_open_the_door(certificates) -> None:
    port = free_endpoint().rpartition(":")[2]
    for scheme, security in (
        ("tcp", Security("learner", insecure=True)),
        ("tls", Security("learner", certificates)),
    ):
        config = TransportConfig(endpoint=f"{scheme}/0.0.0.0:{port}")
        open_learner(config, security=security).close()


MUTUAL = {"listen_certificate": "x", "enable_mtls": True}


@pytest.mark.parametrize(
    ("listen", "tls", "protected"),
    [
        (["tls/0.0.0.0:1"], MUTUAL, True),
        (["quic/0.0.0.0:1"], MUTUAL, True),
        (["tls/0.0.0.0:1"], {"listen_certificate": "x"}, False),
        (["tls/0.0.0.0:1"], {**MUTUAL, "enable_mtls": False}, False),
        (["tcp/0.0.0.0:1"], MUTUAL, False),
        (["udp/10.0.0.1:1"], MUTUAL, False),
        (["tcp/127.0.0.1:1", "tcp/0.0.0.0:2"], MUTUAL, False),
        ("tcp/0.0.0.0:1", {}, False),
        ({"router": ["tcp/127.0.0.1:1"]}, {}, True),
        ({"router": "tcp/10.0.0.1:1"}, {}, False),
        (["tcp/10.0.0.1:1#iface=eth0"], {}, False),
        (["tcp/[::1]:1?prio=1"], {}, True),
        ([], {}, True),
    ],
)  # fmt: skip
def test_what_counts_is_what_zenoh_will_do(listen, tls, protected) -> None:
    """An overlay may listen anywhere, and take the protection away again."""
    found: dict[str, Any] = {
        "listen": {"endpoints": listen},
        "transport": {"link": {"tls": tls}},
    }
    check_exposure(found, insecure=True)
    if protected:
        return check_exposure(found, insecure=False)
    with pytest.raises(UserError, match="is open to other machines and not protected"):
        check_exposure(found, insecure=False)


def test_an_overlay_is_merged_and_comes_last(tmp_path) -> None:
    path = tmp_path / "more.json5"
    path.write_text("// slower\n{transport: {link: {tx: {lease: 9000,},}}, mode: 'client'}")
    below = {
        "mode": "router",
        "transport/link/tx/lease": 3000,
        "transport/link/rx/buffer_size": 4096,
        "listen/endpoints": [TCP],
    }
    built = build(below, Security("learner", overlay=path))
    assert json.loads(built.get_json("transport/link/tx/lease")) == 9000
    assert json.loads(built.get_json("transport/link/rx/buffer_size")) == 4096
    assert json.loads(built.get_json("mode")) == "client"
    path.write_text("{listen: {endpoints: ['tcp/0.0.0.0:7447']}}")
    with pytest.raises(UserError, match=r"tcp/0\.0\.0\.0:7447 is open to other machines"):
        build(below, Security("learner", overlay=path))
    assert merged({"a": {"b": 1, "c": [1]}}, {"a": {"c": [2]}, "d": 3}) == {
        "a": {"b": 1, "c": [2]},
        "d": 3,
    }


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (f"{{mode: '{SECRET}' oops}}", r"line 1, column \d+: is not JSON5"),
        ("{", r"line 1, column \d+: is not JSON5"),
        ("[1]", "must hold keys and values"),
        ("", "is not JSON5"),
        (f"{{transport: {{auth: {{usrpwd: {{pass: '{SECRET}'}}}}}}}}",
         "transport/auth/usrpwd/pass is not a setting of zenoh"),
        (f"{{transport: {{link: {{tx: {{lease: '{SECRET}'}}}}}}}}",
         "transport/link/tx/lease is not a setting of zenoh, or not so"),
    ],
)  # fmt: skip
def test_bad_overlays_are_sentences(text, sentence, tmp_path) -> None:
    path = tmp_path / "more.json5"
    path.write_text(text)
    with pytest.raises(UserError, match=sentence) as caught:
        build({"mode": "router"}, Security("learner", overlay=path))
    assert SECRET not in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(UserError, match="no such file"):
        read_overlay(tmp_path / "none")


def test_secrets_show_nowhere(tmp_path, caplog) -> None:
    """Not in what is printed of a security, of options, of a failed login, nor in logs."""
    from actors.fleet import Fleet
    from actors.worker import WorkerOptions

    caplog.set_level(logging.DEBUG)
    mine = Security("actor", user="actor", password=SECRET)
    fleet = Fleet(TCP, 1, security=mine)
    assert fleet._security is not None and fleet._security["password"] == SECRET
    options = WorkerOptions(TCP, "a", None, 1, "cpu", False, os.getpid(), "", fleet._security)
    assert Security(**fleet._security) == mine
    shown = [repr(mine), str(mine), repr(options)]
    users = private(tmp_path / "users", f"actor:{SECRET}\ndashboard:x")
    config = TransportConfig(endpoint=free_endpoint())
    learner = open_learner(config, "run", Security("learner", users=users))
    wrong = open_actor(
        config.endpoint, config, Security("actor", user="actor", password=SECRET + "-not")
    )
    try:
        from lndrl.transport import Hello

        with pytest.raises(UserError) as caught:
            wrong.hello(Hello("a", "b", "here", 1, 1, "0"), 1.0)
        assert isinstance(learner, ZenohLearner)
        shown += [str(caught.value), caplog.text, learner._desk.answer_ping().decode()]
    finally:
        wrong.close()
        learner.close()
    assert not any(SECRET in text for text in shown)


def test_local_actors_get_what_they_need(certificates, tmp_path) -> None:
    users = private(tmp_path / "users", f"dashboard:x\nactor-here:{SECRET}\nactor:y\n")
    assert Security("learner").of_local("actor") is None
    assert Security("learner", certificates).of_local("actor") == Security("actor", certificates)
    both = Security("learner", certificates, users=users, insecure=True)
    assert both.of_local("actor") == Security(
        "actor", certificates, user="actor-here", password=SECRET
    )
    only = private(tmp_path / "only", "dashboard:x\n")
    with pytest.raises(UserError, match="has no user called actor"):
        Security("learner", users=only).of_local("actor")


def test_the_shipped_files_are_those_of_the_table() -> None:
    """Made anew by ``python -m lndrl.transport.zenoh.deployment deploy/zenoh``."""
    folder = ROOT / "deploy" / "zenoh"
    assert {path.name: path.read_text() for path in folder.iterdir()} == deployment.files()


def test_the_shipped_files_are_accepted_and_enough(certificates, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(certificates.parent)
    deployment.write(tmp_path / "zenoh", ("one", "two"))
    for path in (tmp_path / "zenoh").iterdir():
        build({}, Security("learner", overlay=path, insecure="users" in path.name))
    shipped = ROOT / "deploy" / "zenoh"
    config = TransportConfig(endpoint=free_endpoint().replace("tcp", "tls"))
    guard = Security("learner", overlay=shipped / "learner-tls.json5")
    learner = open_learner(config, "run", guard)
    try:
        from lndrl.transport.keys import HELLO, PING
        from lndrl.transport.zenoh.session import open_connecting

        learner.start(None)  # type: ignore[arg-type]
        for role in ("actor", "dashboard"):
            mine = Security(role, overlay=shipped / f"{role}-tls.json5")
            client = open_connecting(config.endpoint, config, 60, mine)
            assert client.query(PING, timeout=60) is not None
            refused = role == "dashboard"
            assert (client.query(HELLO, b"x", timeout=2 if refused else 60) is None) == refused
            client.close()
    finally:
        learner.close()
