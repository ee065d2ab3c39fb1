"""An operator's file of zenoh settings: whatever it holds, it works or is refused in a sentence."""

from __future__ import annotations

import json
import socket
import time
from pathlib import Path
from typing import Any

import pytest
import zenoh
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport import (
    Hello,
    LearnerUnreachableError,
    Security,
    free_endpoint,
    open_actor,
    open_learner,
    open_viewer,
)
from lndrl.transport.security.exposure import check_exposure, endpoints_of, read_endpoint
from lndrl.transport.zenoh.config import build
from lndrl.transport.zenoh.overlay import at

HELLO = Hello("actor-0", "first", "here", 1, 1, "0")


def overlay(folder: Path, text: str) -> Path:
    path = folder / "more.json5"
    path.write_text(text, encoding="utf-8")
    return path


def refusal(folder: Path, text: str, insecure: bool = False) -> str:
    """What is said of a learner's file, at once and without a network."""
    mine = Security("learner", overlay=overlay(folder, text), insecure=insecure)
    with pytest.raises(UserError) as caught:
        build({"mode": "router", "listen/endpoints": ["tcp/127.0.0.1:7447"]}, mine)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    "key",
    ["listen", "connect", "transport", "transport/link", "transport/link/tls", "transport/auth",
     "transport/auth/usrpwd", "scouting", "scouting/multicast", "access_control", "adminspace",
     "transport/link/tx/queue"],
)  # fmt: skip
def test_a_list_is_no_settings(key: str, tmp_path: Path) -> None:
    """zenoh takes a list for the values of a mapping, in the order of its source."""
    lists: tuple[list[Any], ...] = ([], [[]])
    for empty in lists:
        text = json.dumps(at(key.split("/"), empty))
        sentence = refusal(tmp_path, text)
        assert key in sentence and ("between braces" in sentence or "not a setting" in sentence)
    assert "must hold keys and values between braces" in refusal(tmp_path, "{listen: []}")


@pytest.mark.parametrize("side", ["connect", "listen"])
def test_misspelt_keys_are_named_wherever_they_stand(side: str, tmp_path: Path) -> None:
    """zenoh passes over those below retry in silence."""
    text = f"{{{side}: {{retry: {{period_init: 5}}}}}}"
    expected = f"{side}/retry/period_init is not a setting of zenoh; did you mean period_init_ms?"
    assert expected in refusal(tmp_path, text)
    text = f"{{{side}: {{retry: {{period_init_ms: 5, xyzzy: {{a: 1}}}}}}}}"
    assert f"{side}/retry/xyzzy is not a setting of zenoh" in refusal(tmp_path, text)
    path = overlay(tmp_path, f"{{{side}: {{retry: {{period_init_ms: 5}}}}}}")
    built = build({"mode": "router"}, Security("learner", overlay=path))
    assert json.loads(built.get_json(f"{side}/retry"))["period_init_ms"] == 5


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("{conect: {}}", "conect is not a setting of zenoh, or not so; did you mean connect?"),
        ("{transport: {link: {tsl: {}}}}", "did you mean tls?"),
        ("{scouting: {multicast: {enabeld: true}}}", "did you mean enabled?"),
        ("{xyzzy: 1}", "xyzzy is not a setting of zenoh, or not so"),
        ("{listen: {endpoints: {peer: 5}}}", "listen/endpoints/peer is not a setting"),
    ],
)
def test_misspelt_keys_that_zenoh_refuses_have_a_hint_too(
    text: str, hint: str, tmp_path: Path
) -> None:
    sentence = refusal(tmp_path, text)
    assert hint in sentence and ("did you mean" in sentence) == ("did you mean" in hint)


def test_what_makes_zenoh_panic_or_end_the_process_is_refused(tmp_path: Path) -> None:
    text = "{transport: {multicast: {join_interval: null}}}"
    assert "join_interval must not be null" in refusal(tmp_path, text)
    deep = "{a: " + "[" * 100_000 + "]" * 100_000 + "}"
    assert "is nested too deeply" in refusal(tmp_path, deep)
    overlay(tmp_path, "{scouting: {multicast: {enabled: null}}, namespace: null}")
    build({}, Security("actor", overlay=tmp_path / "more.json5"))


def test_settings_that_do_not_go_with_ours_are_said(tmp_path: Path) -> None:
    path = overlay(tmp_path, "{transport: {unicast: {lowlatency: true}}}")
    with pytest.raises(UserError, match="'qos' and 'lowlatency' options are incompatible") as e:
        open_learner(
            TransportConfig(endpoint=free_endpoint()), security=Security("learner", overlay=path)
        )
    assert "/root/" not in str(e.value) and ".rs:" not in str(e.value)
    for text in (
        "{connect: {endpoints: []}}",
        "{transport: {auth: {usrpwd: {dictionary_file: '/none'}}}}",
    ):
        actor = open_actor(
            free_endpoint(), security=Security("actor", overlay=overlay(tmp_path, text))
        )
        try:
            with pytest.raises(UserError, match="zenoh cannot open a session") as e:
                actor.hello(HELLO, 5)
            assert "waited" not in str(e.value)
        finally:
            actor.close()


@pytest.mark.parametrize(
    ("endpoint", "sentence"),
    [
        ("foo/127.0.0.1:1", "must begin with tcp/, tls/"),
        ("serial//dev/ttyS0", "must begin with tcp/, tls/"),
        ("tcp/127.0.0.1", "needs a host and a port up to 65535"),
        ("tcp/127.0.0.1:99999", "needs a host and a port up to 65535"),
        ("tcp/127.0.0.1:7447#iface=none0", r"no network interface none0; it has .*lo"),
        ("tcp/0.0.0.0:7447#iface=eth0",
         r"open to other machines and not protected on the network of eth0; use --certs FOLDER with"
         r" tls/0\.0\.0\.0:7447, listen on"),
        ("unixsock-stream/?a=1", "needs a file"),
    ],
)  # fmt: skip
def test_endpoints_get_true_sentences(endpoint: str, sentence: str, tmp_path: Path) -> None:
    path = overlay(tmp_path, f"{{listen: {{endpoints: ['{endpoint}']}}}}")
    with pytest.raises(UserError, match=sentence):
        build({"mode": "router"}, Security("learner", overlay=path))


def test_what_only_this_machine_reaches_needs_no_protection() -> None:
    for endpoint in ("unixsock-stream//tmp/x.sock", "tcp/0.0.0.0:1#iface=lo", "tcp/[::1]:1"):
        check_exposure({"listen": {"endpoints": [endpoint]}}, insecure=False)
    groups = {"connect": {"endpoints": {"client": [{"strategy": "x", "endpoints": ["tcp/a:1"]}]}}}
    assert list(endpoints_of(groups, "connect")) == ["tcp/a:1"]
    read = read_endpoint("tls/a.lab:7447?prio=1#iface=eth0;so_sndbuf=1")
    assert (read.scheme, read.host, read.port, read.interface) == ("tls", "a.lab", "7447", "eth0")


def test_a_socket_file_and_an_interface_serve(tmp_path: Path) -> None:
    file = tmp_path / "lndrl.sock"
    _, _, port = free_endpoint().rpartition(":")
    for endpoint in (f"unixsock-stream/{file}", f"tcp/0.0.0.0:{port}#iface=lo"):
        path = overlay(tmp_path, f"{{listen: {{endpoints: ['{endpoint}']}}}}")
        config = TransportConfig(endpoint=free_endpoint())
        open_learner(config, security=Security("learner", overlay=path)).close()


def test_a_port_that_is_taken_is_that_of_the_file(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        path = overlay(tmp_path, f"{{listen: {{endpoints: ['tcp/127.0.0.1:{port}']}}}}")
        config = TransportConfig(endpoint=free_endpoint())
        with pytest.raises(UserError, match=f"port {port} is in use .* in the zenoh settings"):
            open_learner(config, security=Security("learner", overlay=path))
    nowhere = Security("learner", overlay=overlay(tmp_path, "{listen: {endpoints: []}}"))
    with pytest.raises(UserError, match="lets the learner listen nowhere"):
        open_learner(config, security=nowhere)


def test_who_does_not_answer_is_whom_the_file_names(tmp_path: Path) -> None:
    silent, asked = free_endpoint(), free_endpoint()
    file = overlay(tmp_path, f"{{connect: {{endpoints: ['{silent}']}}}}")
    actor = open_actor(asked, security=Security("actor", overlay=file))
    viewer = open_viewer(asked, security=Security("dashboard", overlay=file))
    try:
        for ask in (lambda: actor.hello(HELLO, 0.5), lambda: viewer.status(0.5)):
            with pytest.raises(UserError) as caught:
                ask()
            assert f"{silent} (from {file})" in str(caught.value)
            assert asked not in str(caught.value)
    finally:
        actor.close()
        viewer.close()


def test_an_unknown_host_is_said_at_once_and_by_name(tmp_path: Path) -> None:
    unknown = "tcp/no.such.host.invalid:7447"
    config = TransportConfig(endpoint=unknown)
    began = time.monotonic()
    actor = open_actor(unknown)
    with pytest.raises(LearnerUnreachableError, match=r"host name no\.such\.host\.invalid is unkn"):
        actor.hello(HELLO, 60)
    actor.close()
    viewer = open_viewer(unknown)
    with pytest.raises(UserError, match=r"host name no\.such\.host\.invalid is unknown"):
        viewer.status(60)
    viewer.close()
    anywhere = Security("learner", insecure=True)
    with pytest.raises(UserError, match=r"host name no\.such\.host\.invalid is unknown"):
        open_learner(config, security=anywhere)
    router = config.model_copy(update={"router": True})
    with pytest.raises(UserError, match=r"host name no\.such\.host\.invalid is unknown"):
        open_learner(router)
    text = "{connect: {endpoints: ['tcp/also.no.host.invalid:1']}}"
    actor = open_actor(free_endpoint(), security=Security("actor", overlay=overlay(tmp_path, text)))
    with pytest.raises(LearnerUnreachableError, match=r"host name also\.no\.host\.invalid is"):
        actor.hello(HELLO, 60)
    actor.close()
    assert time.monotonic() - began < 30


def _places(nested: Any, above: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    found = []
    for key, value in nested.items():
        found.append((*above, key))
        if isinstance(value, dict):
            found += _places(value, (*above, key))
    return found


PLACES = [
    *_places(json.loads(str(zenoh.Config()))),
    *((side, "retry", key) for side in ("listen", "connect") for key in ("period_init_ms", "x")),
    ("listen", "endpoints", "router"),
]
WORDS = st.one_of(
    st.text(max_size=8),
    st.sampled_from(["tcp/127.0.0.1:0", "tcp/a", "tls/[::1]:1#iface=lo", "unixsock-stream//x"]),
)
ANYTHING = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), WORDS),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=8), inner, max_size=3)
    ),
    max_leaves=8,
)


@settings(max_examples=200)
@given(place=st.sampled_from(PLACES), value=ANYTHING)
@example(place=("listen",), value=[])
@example(place=("scouting",), value={"delay": float("inf")})
@example(place=("listen", "endpoints"), value=["tcp/\ud800:1"])
@example(place=("listen", "endpoints"), value=["tcp/127.0.0.1:²"])
@example(place=("transport", "link", "rx", "max_message_size"), value=10**30)
def test_any_value_in_any_place_is_taken_or_refused_in_a_sentence(
    place: tuple[str, ...], value: Any, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.json5"
    path.write_text(json.dumps(at(place, value)))
    for role in ("learner", "actor"):
        mine = Security(role, overlay=path, insecure=True)
        try:
            build({"mode": "router", "listen/endpoints": ["tcp/127.0.0.1:7447"]}, mine)
        except UserError as error:
            assert "\n" not in str(error)


VALUES = [0, 1, -1, 2**63, 0.5, "", "x", [], ["x"], [0], {}, {"a": 1}, {"router": 1}, None, True]


def test_what_is_taken_opens_or_is_refused_in_a_sentence(tmp_path: Path) -> None:
    """Every setting, with values of every kind: no panic, no other exception, no hang."""
    base = {"mode": "router", "scouting/multicast/enabled": False}
    opened = 0
    for place in PLACES:
        if place[-1] in ("delay", "timeout"):
            continue  # that long is waited for what is never found, as was asked
        for value in VALUES:
            path = overlay(tmp_path, json.dumps(at(place, value)))
            mine = Security("learner", overlay=path, insecure=True)
            try:
                build(base, mine)
            except UserError:
                continue
            opened += 1
            try:
                config = TransportConfig(endpoint=free_endpoint())
                open_learner(config, security=mine).close()
            except UserError as error:
                assert "longer than" not in str(error), (place, value)
    assert opened > 200
