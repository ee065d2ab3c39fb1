"""The same behaviour in memory and over Zenoh on loopback."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport import (
    NO_WEIGHTS,
    UNKNOWN_ACTOR,
    Ack,
    ChunkHeader,
    Hello,
    MemoryNetwork,
    MessageError,
    Refusal,
    WeightsGoneError,
    Welcome,
    free_endpoint,
    open_actor,
    open_learner,
    open_viewer,
)
from lndrl.transport.frames import encode_frame
from tests.lndrl.transport.test_frames import arrays, frame

PATIENCE = 60.0  # s, for machines with much else to do
HELLO = Hello("actor-0", "first", "here", 1, 8, "0.1")


class RecordingHandlers:
    """Welcomes everybody but ``banned``; keeps what arrives; acks by ``answer``."""

    def __init__(self) -> None:
        self.hellos: list[Hello] = []
        self.chunks: list[tuple[ChunkHeader, dict, int]] = []
        self.members: list[tuple[str, str, bool]] = []
        self.answer: Callable[[ChunkHeader], Ack] = lambda header: Ack("accepted")

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        self.hellos.append(hello)
        if hello.actor_id == "banned":
            return Refusal("banned actors may not join")
        return Welcome("run-1", {"seed": 7, "nested": {"a": [1, 2]}}, len(self.hellos) - 1)

    def on_chunk(self, header: ChunkHeader, arrays: dict, size: int) -> Ack:
        self.chunks.append((header, arrays, size))
        return self.answer(header)

    def on_malformed(self, reason: str) -> None:
        pass

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        self.members.append((actor_id, incarnation, alive))

    def sequences(self) -> list[int]:
        return [header.sequence for header, _, _ in self.chunks]


class Setup:
    """Makes endpoints of one kind and closes them all."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.config = TransportConfig(
            endpoint=free_endpoint(), upload_timeout=20.0, upload_window=2, lease=10.0
        )
        self.network = MemoryNetwork(self.config)
        self.open: list = []

    def learner(self, handlers: RecordingHandlers):
        memory = self.kind == "memory"
        endpoint = self.network.learner("run-1") if memory else open_learner(self.config, "run-1")
        self.open.append(endpoint)
        endpoint.start(handlers)
        return endpoint

    def actor(self):
        memory = self.kind == "memory"
        self.open.append(
            self.network.actor() if memory else open_actor(self.config.endpoint, self.config)
        )
        return self.open[-1]

    def viewer(self):
        memory = self.kind == "memory"
        self.open.append(self.network.viewer() if memory else open_viewer(self.config.endpoint))
        return self.open[-1]


@pytest.fixture(params=["memory", "zenoh"])
def setup(request) -> Iterator[Setup]:
    made = Setup(request.param)
    yield made
    for endpoint in reversed(made.open):
        endpoint.close()


def chunk(sequence: int, fill: int = 0) -> tuple[ChunkHeader, dict]:
    header = ChunkHeader("run-1", "actor-0", "first", sequence, 64, 8, [{"outcome": "lost"}])
    return header, {"scan": np.full((4, 720), fill, np.uint16), "reward": np.ones(4, np.float32)}


def eventually(condition: Callable[[], bool], seconds: float = PATIENCE) -> bool:
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True


def test_hello_is_welcomed_with_config_and_incarnation(setup):
    learner = setup.learner(handlers := RecordingHandlers())
    welcome = setup.actor().hello(HELLO, timeout=PATIENCE)
    assert handlers.hellos == [HELLO]
    assert welcome.run_id == "run-1"
    assert welcome.config == {"seed": 7, "nested": {"a": [1, 2]}}
    assert welcome.learner_incarnation == learner.incarnation
    assert welcome.weights_version == NO_WEIGHTS


def test_refusals_are_sentences(setup):
    setup.learner(handlers := RecordingHandlers())
    with pytest.raises(UserError, match="banned actors may not join"):
        setup.actor().hello(dataclasses.replace(HELLO, actor_id="banned"), timeout=PATIENCE)
    with pytest.raises(UserError, match="speaks protocol 1, this actor 99"):
        setup.actor().hello(dataclasses.replace(HELLO, protocol=99), timeout=PATIENCE)
    assert len(handlers.hellos) == 1


def test_without_a_learner_hello_says_so_in_time(setup):
    start = time.monotonic()
    with pytest.raises(UserError, match="no learner"):
        setup.actor().hello(HELLO, timeout=0.5)
    with pytest.raises(UserError):
        setup.viewer().status(timeout=0.5)
    assert time.monotonic() - start < 10, "not what is waited by default"


def test_uploads_arrive_in_order_once_and_are_acked(setup):
    learner = setup.learner(handlers := RecordingHandlers())
    actor = setup.actor()
    with pytest.raises(RuntimeError, match="hello"):
        actor.upload(*chunk(1))
    actor.hello(HELLO, timeout=PATIENCE)
    learner.publish_weights(4, b"four")
    for sequence in range(1, 21):
        actor.upload(*chunk(sequence, fill=sequence))
    assert actor.flush(PATIENCE)
    assert handlers.sequences() == list(range(1, 21))
    acks = actor.acks()
    assert [ack.status for ack in acks] == ["accepted"] * 20
    assert {(ack.weights_version, ack.learner_incarnation) for ack in acks} == {
        (4, learner.incarnation)
    }
    assert actor.acks() == []
    header, arrays, size = handlers.chunks[6]
    assert header == chunk(7)[0]
    assert arrays["scan"].shape == (4, 720)
    assert (arrays["scan"] == 7).all()
    assert size > arrays["scan"].nbytes


def test_final_answers_settle_and_done_is_told(setup):
    setup.learner(handlers := RecordingHandlers())
    statuses = ["duplicate", "stale", "refused", "accepted"]
    handlers.answer = lambda header: Ack(
        statuses[header.sequence], reason="because", done=header.sequence == 3
    )
    actor = setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    for sequence in range(4):
        assert not actor.done()
        actor.upload(*chunk(sequence))
        assert actor.flush(PATIENCE)
    assert [(ack.status, ack.reason) for ack in actor.acks()] == [(s, "because") for s in statuses]
    assert actor.done()
    assert handlers.sequences() == [0, 1, 2, 3]


def test_pause_sends_the_same_sequence_again(setup):
    setup.learner(handlers := RecordingHandlers())
    handlers.answer = lambda header: Ack("pause" if len(handlers.chunks) < 3 else "accepted")
    actor = setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    actor.upload(*chunk(1))
    assert actor.flush(PATIENCE)
    assert handlers.sequences() == [1, 1, 1]
    assert [ack.status for ack in actor.acks()] == ["accepted"]


def test_a_failing_handler_refuses_and_lives_on(setup):
    setup.learner(handlers := RecordingHandlers())

    def answer(header: ChunkHeader) -> Ack:
        if header.sequence == 1:
            raise ZeroDivisionError
        return Ack("accepted")

    handlers.answer = answer
    actor = setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    actor.upload(*chunk(1))
    actor.upload(*chunk(2))
    assert actor.flush(PATIENCE)
    assert sorted(ack.status for ack in actor.acks()) == ["accepted", "refused"]


def test_a_slow_learner_holds_the_actor_back(setup):
    setup.learner(handlers := RecordingHandlers())
    gate = threading.Semaphore(0)

    def wait_for_gate(header: ChunkHeader) -> Ack:
        gate.acquire()
        return Ack("accepted")

    handlers.answer = wait_for_gate
    actor = setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    sent = []

    def send() -> None:
        for sequence in range(6):
            actor.upload(*chunk(sequence))
            sent.append(sequence)

    thread = threading.Thread(target=send)
    thread.start()
    time.sleep(0.5)
    assert len(sent) <= 2
    for _ in range(30):
        gate.release()
    thread.join(PATIENCE)
    assert not thread.is_alive()
    assert actor.flush(PATIENCE)
    assert len(actor.acks()) == 6
    assert set(handlers.sequences()) == set(range(6))


def test_other_questions_are_answered_while_an_upload_stalls(setup):
    learner = setup.learner(handlers := RecordingHandlers())
    learner.publish_status({"steps": 5}, [])
    learner.publish_weights(1, b"one")
    gate, answered = threading.Event(), threading.Event()

    def stall(header: ChunkHeader) -> Ack:
        gate.wait(5 * PATIENCE)
        answered.set()
        return Ack("accepted")

    handlers.answer = stall
    actor, viewer, other = setup.actor(), setup.viewer(), setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    viewer.status(timeout=PATIENCE)
    thread = threading.Thread(target=actor.upload, args=chunk(1))
    thread.start()
    assert eventually(lambda: bool(handlers.chunks))
    assert viewer.status(timeout=PATIENCE)["snapshot"] == {"steps": 5}
    assert actor.fetch(timeout=PATIENCE) == (1, b"one")
    other.hello(dataclasses.replace(HELLO, actor_id="actor-1"), timeout=PATIENCE)
    assert not answered.is_set()
    gate.set()
    thread.join(PATIENCE)
    assert actor.flush(PATIENCE)
    assert answered.is_set()


def test_the_last_two_versions_can_be_fetched(setup):
    learner = setup.learner(RecordingHandlers())
    actor = setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    with pytest.raises(TimeoutError):
        actor.fetch(timeout=0.3)
    for version in range(3):
        learner.publish_weights(version, bytes([version]) * 100_000)
    assert actor.fetch(timeout=PATIENCE) == (2, b"\x02" * 100_000)
    assert actor.fetch(1, timeout=PATIENCE) == (1, b"\x01" * 100_000)
    with pytest.raises(WeightsGoneError):
        actor.fetch(0, timeout=PATIENCE)
    with pytest.raises(TimeoutError):
        actor.fetch(3, timeout=0.3)
    with pytest.raises(ValueError, match="older"):
        learner.publish_weights(1, b"x")


def test_weights_are_announced_also_to_late_joiners(setup):
    learner = setup.learner(RecordingHandlers())
    early = setup.actor()
    early.hello(HELLO, timeout=PATIENCE)
    assert early.newest() == (NO_WEIGHTS, learner.incarnation)
    assert not early.wait_newer(NO_WEIGHTS, 0.0)
    learner.publish_weights(5, b"five")
    assert early.wait_newer(NO_WEIGHTS, PATIENCE)
    assert early.newest() == (5, learner.incarnation)
    late = setup.actor()
    late.hello(dataclasses.replace(HELLO, actor_id="late"), timeout=PATIENCE)
    assert late.newest() == (5, learner.incarnation)
    assert late.fetch(timeout=PATIENCE) == (5, b"five")


def test_finish_reaches_idle_actors(setup):
    learner = setup.learner(RecordingHandlers())
    actor = setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    learner.finish()
    assert actor.wait_newer(NO_WEIGHTS, PATIENCE)
    assert actor.done()
    actor.upload(*chunk(1))
    assert actor.flush(PATIENCE)
    assert [ack.done for ack in actor.acks()] == [True]


def test_members_come_and_go(setup):
    setup.learner(handlers := RecordingHandlers())
    actor = setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    assert eventually(lambda: ("actor-0", "first", True) in handlers.members)
    actor.close()
    assert eventually(lambda: handlers.members[-1] == ("actor-0", "first", False))


def test_viewers_query_and_stream(setup):
    learner = setup.learner(RecordingHandlers())
    viewer = setup.viewer()
    with pytest.raises(UserError):
        viewer.status(timeout=0.3)
    learner.publish_status(
        {"steps": np.int64(1), "kl": float("nan"), "lag": np.float32("inf")}, [{"rate": 2.5}]
    )
    assert viewer.status(timeout=PATIENCE) == {
        "snapshot": {"steps": 1, "kl": None, "lag": None},
        "history": [{"rate": 2.5}],
    }
    seen = []

    def watch() -> None:
        seen.extend(viewer.stream(silence=0.2))

    thread = threading.Thread(target=watch)
    thread.start()
    assert eventually(lambda: None in seen)
    deadline = time.monotonic() + PATIENCE
    while {"steps": 2} not in seen and time.monotonic() < deadline:
        learner.publish_status({"steps": 2}, [])
        time.sleep(0.05)
    assert {"steps": 2} in seen
    viewer.close()
    thread.join(PATIENCE)
    assert not thread.is_alive()


def test_a_restarted_learner_gets_what_was_pending(setup):
    old = setup.learner(RecordingHandlers())
    actor = setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    old.publish_weights(9, b"nine")
    assert actor.wait_newer(NO_WEIGHTS, PATIENCE)
    old.close()
    actor.upload(*chunk(1))
    assert not actor.flush(0.1)
    actor.upload(*chunk(2))
    with pytest.raises(TimeoutError):
        actor.upload(*chunk(3), timeout=0.1)
    assert actor.pending() == 2
    assert 0.1 < actor.silence() < PATIENCE

    handlers = RecordingHandlers()
    handlers.answer = lambda header: (
        Ack("accepted") if handlers.hellos else Ack("refused", reason=UNKNOWN_ACTOR)
    )
    new = setup.learner(handlers)
    new.publish_weights(3, b"three")
    actor.flush(0.0)
    assert eventually(actor.needs_hello)
    actor.upload(*chunk(3))  # does not block: only this thread can say hello
    with pytest.raises(RuntimeError, match="hello"):
        actor.upload(*chunk(4))
    actor.hello(HELLO, timeout=PATIENCE)
    assert not actor.needs_hello()
    assert actor.flush(PATIENCE)
    assert set(handlers.sequences()) == {1, 2, 3}
    assert [ack.status for ack in actor.acks()] == ["accepted"] * 3
    assert actor.silence() < PATIENCE
    assert actor.newest() == (3, new.incarnation)
    assert actor.pending() == 0


def test_waiting_ends_when_another_learner_appears(setup):
    old = setup.learner(RecordingHandlers())
    old.publish_weights(2, b"two")
    actor = setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    old.close()
    new = setup.learner(RecordingHandlers())
    new.publish_weights(2, b"again")
    assert actor.wait_newer(2, PATIENCE)
    assert actor.needs_hello()
    assert actor.newest() == (2, new.incarnation)


def test_closing_twice_and_uploading_afterwards(setup):
    setup.learner(RecordingHandlers())
    actor = setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    actor.close()
    actor.close()
    with pytest.raises(RuntimeError, match="closed"):
        actor.upload(*chunk(1))


def test_a_world_is_shown_while_somebody_watches(setup):
    setup.learner(RecordingHandlers())
    actors = [setup.actor() for _ in range(2)]
    for i, actor in enumerate(actors):
        actor.hello(dataclasses.replace(HELLO, actor_id=f"actor-{i}"), timeout=PATIENCE)
    shown, other = actors
    assert not shown.watched(), "nobody asked"
    viewers = [setup.viewer() for _ in range(2)]
    seats = [viewer.watch("actor-0") for viewer in viewers]
    assert eventually(shown.watched)
    assert not other.watched(), "somebody else was asked"
    seen: list[list[int]] = [[], []]

    def both() -> bool:
        shown.show(encode_frame(frame(sequence=len(seen[0]) + len(seen[1])), arrays()))
        for seat, numbers in zip(seats, seen, strict=True):
            if (found := seat.newest()) is not None:
                numbers.append(found[0].sequence)
        return all(len(numbers) >= 2 for numbers in seen)

    assert eventually(both)
    seats[0].close()
    assert not eventually(lambda: not shown.watched(), 0.3), "the other one still watches"
    viewers[1].close()  # as when a terminal is closed
    if setup.kind == "memory":
        seats[1].close()
    assert eventually(lambda: not shown.watched())
    shown.show(b"to nobody, and nothing is raised")
    seats[0].close()


def test_what_is_no_frame_is_said(setup):
    setup.learner(RecordingHandlers())
    actor, viewer = setup.actor(), setup.viewer()
    actor.hello(HELLO, timeout=PATIENCE)
    seat = viewer.watch("actor-0")
    assert eventually(actor.watched)
    actor.show(b"what another version says")

    def refused() -> bool:
        try:
            return seat.newest() is not None
        except (UserError, MessageError) as error:
            assert "magic" in str(error)
            return True

    assert eventually(refused)
    seat.close()
