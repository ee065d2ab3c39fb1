"""What only a network can do wrong: kills, lost answers, busy ports, bad addresses, exits."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, closing
from typing import Any

import numpy as np
import pytest
import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport import (
    Ack,
    ChunkHeader,
    Hello,
    MessageError,
    Refusal,
    Welcome,
    free_endpoint,
    open_actor,
    open_learner,
    open_viewer,
)
from lndrl.transport.keys import ANNOUNCE, PING, UPLOAD, WEIGHTS
from lndrl.transport.ledger import Entry
from lndrl.transport.messages import decode, digest
from lndrl.transport.security.identity import Security
from lndrl.transport.zenoh.session import ZenohSession, open_connecting

PATIENCE = 60.0  # s, for machines with much else to do
HELLO = Hello("actor-0", "first", "here", 1, 8, "0.1")


class CountingHandlers:
    """Welcomes everybody and keeps sequences and members; an upload waits for ``gate``."""

    def __init__(self) -> None:
        self.sequences: list[int] = []
        self.members: list[tuple[str, bool]] = []
        self.gate = threading.Event()
        self.gate.set()

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        return Welcome("run", {}, 0)

    def on_chunk(self, header: ChunkHeader, arrays: dict, size: int) -> Ack:
        seen = header.sequence in self.sequences
        self.sequences.append(header.sequence)
        self.gate.wait(5 * PATIENCE)
        return Ack("duplicate" if seen else "accepted")

    def on_malformed(self, reason: str) -> None:
        pass

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        self.members.append((actor_id, alive))


@pytest.fixture
def opened():
    """Has what it is given closed when the test is over, the newest first."""
    with ExitStack() as stack:
        yield lambda endpoint: stack.enter_context(closing(endpoint))


def settings(**changes) -> TransportConfig:
    values = {"endpoint": free_endpoint(), "upload_timeout": 20.0, "lease": 10.0, **changes}
    return TransportConfig(**values)


def wait_until(condition, seconds: float = PATIENCE) -> bool:
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return condition()


def joined(opened, config: TransportConfig, handlers: CountingHandlers, learner=None):
    """An actor that ``learner``, a new one by default, has welcomed."""
    learner = learner or opened(open_learner(config))
    actor = opened(open_actor(config.endpoint, config))
    learner.start(handlers)
    actor.hello(HELLO, PATIENCE)
    return actor


def send(actor, sequence: int, size: int = 1000) -> None:
    header = ChunkHeader("run", "actor-0", "first", sequence, 1, 1)
    actor.upload(header, {"x": np.zeros(size, np.uint8)})


def test_a_late_ack_makes_the_same_sequence_come_again_and_only_that(opened):
    config = settings()
    handlers = CountingHandlers()
    learner = opened(open_learner(config))
    came: list[str] = []
    queue = learner._uploads._uploads
    put = queue.put

    def note_coming(query: zenoh.Query) -> None:
        put(query)
        came.append(str(query.key_expr))

    queue.put = note_coming
    actor = joined(opened, config, handlers, learner)
    left: list[float] = []
    carry = actor._send

    def note_leaving(session: ZenohSession, entry: Entry) -> Any:
        left.append(actor._config.upload_timeout)
        return carry(session, entry)

    actor._send = note_leaving
    send(actor, 1)
    assert actor.flush(PATIENCE)
    handlers.gate.clear()
    actor.adopt(config.model_copy(update={"upload_timeout": 0.2}))
    send(actor, 2)
    assert wait_until(lambda: len(came) >= 1 + 4)
    # The last copy may be answered late: none is sent after it.
    actor.adopt(config)
    assert wait_until(lambda: left[-1] == config.upload_timeout and len(came) == len(left))
    handlers.gate.set()
    assert actor.flush(PATIENCE)
    assert len(set(came)) == 2
    # Those that waited were merged into one.
    assert handlers.sequences == [1, 2, 2]
    assert [ack.status for ack in actor.acks()] == ["accepted", "duplicate"]


def test_a_session_that_gets_no_answers_is_opened_anew(opened):
    config = settings(upload_window=1)
    handlers = CountingHandlers()
    learner = opened(open_learner(config))
    actor = joined(opened, config, handlers, learner)
    first = actor._session
    first.zenoh.close()  # as if the link were dead for good
    send(actor, 1)
    assert actor.flush(PATIENCE)
    assert actor._session is not first
    assert handlers.sequences == [1]
    assert wait_until(lambda: handlers.members[-1] == ("actor-0", True))
    learner.publish_weights(1, b"w")
    assert actor.wait_newer(-1, PATIENCE)


CHILD = """
import sys, time
from lndrl.transport import Hello, open_actor
actor = open_actor(sys.argv[1])
actor.hello(Hello("child", "one", "here", 1, 1, "0"), 60)
try:
    print("ready", flush=True)
    if sys.argv[2] == "stay":
        time.sleep(600)
    if sys.argv[2] == "interrupt":
        actor.wait_newer(-1, 600)
except KeyboardInterrupt:
    sys.exit(7)
"""


def run_child(endpoint: str, how: str) -> subprocess.Popen[bytes]:
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, endpoint, how], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert child.stdout is not None and child.stderr is not None
    assert child.stdout.readline().strip() == b"ready", child.stderr.read()
    return child


@pytest.mark.parametrize(("how", "signal", "code"), [("stay", 9, -9), ("interrupt", 2, 7)])
def test_an_actor_that_ends_is_reported_gone(opened, how, signal, code):
    config = settings()
    handlers = CountingHandlers()
    learner = opened(open_learner(config))
    learner.start(handlers)
    child = run_child(config.endpoint, how)
    assert wait_until(lambda: ("child", True) in handlers.members)
    child.send_signal(signal)
    assert child.wait(PATIENCE) == code
    assert wait_until(lambda: ("child", False) in handlers.members)


def test_leaving_without_close_neither_hangs_nor_aborts(opened):
    config = settings()
    learner = opened(open_learner(config))
    learner.start(CountingHandlers())
    child = run_child(config.endpoint, "leave")
    assert child.stderr is not None
    assert child.wait(PATIENCE) == 0, child.stderr.read()
    code = (
        "import sys\nfrom lndrl.config import TransportConfig\n"
        "from lndrl.transport import open_learner\n"
        "open_learner(TransportConfig(endpoint=sys.argv[1])).start(None)\nsys.exit(5)\n"
    )
    listening = subprocess.run([sys.executable, "-c", code, free_endpoint()], timeout=3 * PATIENCE)
    assert listening.returncode == 5


def test_a_busy_port_is_a_sentence_and_a_closed_one_is_free_again():
    config = settings()
    learner = open_learner(config)
    port = config.endpoint.rsplit(":", 1)[1]
    with pytest.raises(UserError, match=f"port {port} is in use"):
        open_learner(config)
    learner.close()
    open_learner(config).close()


@pytest.mark.parametrize(
    "endpoint",
    ["", "7447", "127.0.0.1:7447", "tcp/127.0.0.1", "tcp/127.0.0.1:0", "tcp/127.0.0.1:99999",
     "udp/127.0.0.1:7447", "tcp/a b:1", 'tcp/x:1"]'],
)  # fmt: skip
def test_bad_endpoints_are_sentences(endpoint):
    for opening in (
        lambda: open_learner(TransportConfig(endpoint=endpoint)),
        lambda: open_actor(endpoint),
        lambda: open_viewer(endpoint),
    ):
        with pytest.raises(UserError, match="must look like tcp/HOST:PORT"):
            opening()


def test_addresses_of_others_are_sentences():
    anywhere = Security("learner", insecure=True)
    with pytest.raises(UserError, match="does not have the address"):
        open_learner(TransportConfig(endpoint="tcp/192.0.2.1:7447"), security=anywhere)
    with pytest.raises(UserError, match="is unknown"):
        open_learner(TransportConfig(endpoint="tcp/no.such.host.invalid:7447"), security=anywhere)


def test_an_oversized_chunk_is_refused_before_it_is_sent(opened):
    config = settings(max_message_megabytes=1)
    actor = joined(opened, config, CountingHandlers())
    with pytest.raises(MessageError, match="exceeds"):
        send(actor, 1, size=2**20 + 1)
    assert actor.pending() == 0


def test_garbage_is_refused_and_the_learner_lives_on(opened):
    config = settings()
    handlers = CountingHandlers()
    actor = joined(opened, config, handlers)
    stranger = opened(open_connecting(config.endpoint, config, PATIENCE))
    answer = stranger.query(f"{UPLOAD}/x/y/1", b"garbage", PATIENCE)
    assert decode(answer.payload.to_bytes(), Ack)[0].status == "refused"
    answer = stranger.query("lndrl/hello", b"\x00" * 50, PATIENCE)
    assert isinstance(decode(answer.payload.to_bytes(), Welcome, Refusal)[0], Refusal)
    stranger.zenoh.put(ANNOUNCE, b"garbage")
    stranger.query("lndrl/weights", b"\xff\xff" * 100, PATIENCE)
    send(actor, 1)
    assert actor.flush(PATIENCE)
    assert handlers.sequences == [1]


def test_whoever_sent_garbage_waits_and_an_actor_that_works_does_not(opened, monkeypatch):
    monkeypatch.setattr("lndrl.transport.uploads.REFUSING", 1e-9)
    config = settings()
    handlers = CountingHandlers()
    actor = joined(opened, config, handlers)
    stranger = opened(open_connecting(config.endpoint, config, PATIENCE))
    send(actor, 1)
    assert actor.flush(PATIENCE)
    answer = stranger.query(f"{UPLOAD}/x/y/1", b"garbage", PATIENCE)
    assert decode(answer.payload.to_bytes(), Ack)[0].status == "refused"
    assert stranger.query(f"{UPLOAD}/x/y/2", b"garbage", 0.5) is None
    send(actor, 2)
    assert actor.flush(PATIENCE)
    assert handlers.sequences == [1, 2]


def test_what_asks_for_no_version_gets_no_weights(opened):
    config = settings()
    learner = opened(open_learner(config))
    session = opened(open_connecting(config.endpoint, config, PATIENCE))
    learner.start(CountingHandlers())
    learner.publish_weights(3, b"w" * 1000)
    sizes = {}
    for payload in (b"", b"3", b"4", b"-1", b"1e9", "²".encode(), b"\xff" * 1000, b"9" * 400):
        sample = session.query(WEIGHTS, payload, PATIENCE)
        assert sample is not None and sample.attachment is not None
        sizes[payload] = len(sample.payload.to_bytes())
    assert {payload for payload, size in sizes.items() if size} == {b"", b"3"}
    assert session.query(f"{WEIGHTS}/**", timeout=1.0) is None


def test_an_upload_that_breaks_the_desk_is_not_the_last(opened):
    config = settings()
    handlers = CountingHandlers()
    learner = opened(open_learner(config))
    right, broken = learner._desk.answer_chunk, [True]

    def answer(data: bytes) -> Ack:
        if broken:
            broken.pop()
            raise RuntimeError("a bug")
        return right(data)

    learner._desk.answer_chunk = answer
    actor = joined(opened, config, handlers, learner)
    send(actor, 1)
    assert actor.flush(PATIENCE)
    assert handlers.sequences == [1]


def test_a_ping_names_the_run_once_the_status_does(opened):
    config = settings()
    learner = opened(open_learner(config))
    stranger = opened(open_connecting(config.endpoint, config, PATIENCE))
    learner.start(CountingHandlers())

    def run_id() -> str:
        return json.loads(stranger.query(PING, timeout=PATIENCE).payload.to_bytes())["run_id"]

    assert run_id() == ""
    learner.publish_status({"run_id": "first-1"}, [])
    assert run_id() == "first-1"


def test_300_members_are_known_at_once(opened):
    config = settings()
    handlers = CountingHandlers()
    learner = opened(open_learner(config))
    crowd = opened(open_connecting(config.endpoint, config, PATIENCE))
    tokens = [crowd.zenoh.liveliness().declare_token(f"lndrl/actors/a{i}/x") for i in range(300)]
    time.sleep(0.3)
    learner.start(handlers)
    assert wait_until(lambda: len(handlers.members) == 300)
    assert len(tokens) == 300


def test_close_is_quick_while_an_upload_stalls():
    config = settings()
    handlers = CountingHandlers()
    handlers.gate.clear()
    learner, actor = open_learner(config), open_actor(config.endpoint, config)
    learner.start(handlers)
    actor.hello(HELLO, PATIENCE)
    send(actor, 1)
    assert wait_until(lambda: bool(handlers.sequences))
    start = time.monotonic()
    actor.close()
    learner.close()
    assert time.monotonic() - start < PATIENCE, "the upload stalls for five times as long"
    handlers.gate.set()


def test_no_threads_are_left_behind():
    config = settings()
    before = threading.active_count()
    learner, actor = open_learner(config), open_actor(config.endpoint, config)
    viewer = open_viewer(config.endpoint)
    learner.start(CountingHandlers())
    learner.publish_status({}, [])
    actor.hello(HELLO, PATIENCE)
    viewer.status(PATIENCE)
    viewer.close()
    actor.close()
    learner.close()
    assert wait_until(lambda: threading.active_count() <= before)


def test_a_truncated_blob_is_noticed(opened):
    """A stranger that answers for the learner with other bytes than it announces is refused."""
    config = settings()
    learner = opened(open_learner(config))
    actor = joined(opened, config, CountingHandlers(), learner)
    learner.publish_weights(1, b"right")
    learner._payload = (digest(b"right"), zenoh.ZBytes(b"wrong"))
    with pytest.raises(MessageError, match="damaged"):
        actor.fetch(timeout=PATIENCE)
