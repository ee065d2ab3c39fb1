"""The same behaviour in memory and over Zenoh on loopback."""

from __future__ import annotations

import dataclasses
import threading
import time

import pytest

from lndrl.errors import UserError
from lndrl.transport import (
    NO_WEIGHTS,
    UNKNOWN_ACTOR,
    Ack,
    ChunkHeader,
    WeightsGoneError,
)
from tests.lndrl.transport.setups import HELLO, PATIENCE, RecordingHandlers, chunk, eventually


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
