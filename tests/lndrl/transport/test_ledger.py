"""The actor's book: order, holding, and words that arrive late."""

from __future__ import annotations

import json

import pytest

from lndrl.errors import UserError
from lndrl.transport.ledger import Entry, Ledger
from lndrl.transport.messages import NO_WEIGHTS, UNKNOWN_ACTOR, Ack, Welcome


def greeted(ledger: Ledger, learner: str = "old", version: int = NO_WEIGHTS) -> Ledger:
    ledger.welcomed(Welcome("run", {}, 0, version, learner))
    return ledger


def entry(sequence: int) -> Entry:
    return Entry("actor", "one", sequence, b"")


def test_chunks_leave_oldest_first_also_when_one_comes_back():
    ledger = greeted(Ledger(3))
    first, second, third = entry(1), entry(2), entry(3)
    for chunk in (first, second, third):
        ledger.add(chunk)
    assert not ledger.has_room()
    assert ledger.take() is first
    assert ledger.take() is second
    ledger.postpone(first, 0.0)
    assert ledger.take() is first
    assert ledger.take() is third
    assert ledger.take(block=False) is None


def test_late_words_of_a_learner_that_was_replaced_do_not_count():
    ledger = greeted(Ledger(2), "old", 9)
    ledger.heard(3, "new")
    assert ledger.newest() == (3, "new")
    assert ledger.needs_hello()
    greeted(ledger, "new", 3)
    ledger.heard(10, "old", done=True)
    assert ledger.newest() == (3, "new")
    assert not ledger.done()
    assert not ledger.needs_hello()
    ledger.heard(2, "new")
    assert ledger.newest() == (3, "new")


def test_a_refusal_from_before_the_latest_hello_does_not_hold_uploads():
    ledger = greeted(Ledger(2))
    ledger.add(entry(1))
    ledger.add(entry(2))
    early, late = ledger.take(), ledger.take()
    assert early is not None and late is not None
    unknown = Ack("refused", reason=UNKNOWN_ACTOR, learner_incarnation="new")
    ledger.settle(early, unknown)
    assert ledger.needs_hello()
    assert ledger.take(block=False) is None
    greeted(ledger, "new")
    ledger.settle(late, unknown)
    assert not ledger.needs_hello()
    assert ledger.take() is early
    assert ledger.take() is late


def test_a_second_answer_to_the_same_chunk_changes_nothing():
    ledger = greeted(Ledger(2))
    ledger.add(entry(1))
    chunk = ledger.take()
    assert chunk is not None
    ledger.settle(chunk, Ack("accepted"))
    ledger.settle(chunk, Ack("duplicate"))
    assert [ack.status for ack in ledger.drain_acks()] == ["accepted"]
    assert ledger.pending() == 0


def test_an_upload_needs_a_hello():
    with pytest.raises(RuntimeError, match="hello"):
        Ledger(2).check_ready()


def test_a_book_notes_what_was_taken_and_what_became_of_it(tmp_path):
    path = tmp_path / "book.jsonl"
    ledgers = [greeted(Ledger(2)) for _ in range(2)]
    for number, ledger in enumerate(ledgers):
        ledger.keep_book(path)
        ledger.add(Entry(f"a{number}", "one", 1, b"", samples=32))
        chunk = ledger.take()
        assert chunk is not None
        ledger.settle(chunk, Ack("pause"))
        ledger.settle(chunk, Ack("accepted"))
        ledger.settle(chunk, Ack("duplicate"))
        ledger.close()
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert lines == [
        line
        for actor in ("a0", "a1")
        for line in (
            {"kind": "produced", "actor": actor, "life": "one", "sequence": 1, "samples": 32},
            {"kind": "settled", "actor": actor, "life": "one", "sequence": 1, "status": "accepted"},
        )
    ]


def test_a_book_that_cannot_be_written_is_one_sentence(tmp_path):
    with pytest.raises(UserError, match="--ledger"):
        Ledger(2).keep_book(tmp_path / "nowhere" / "book.jsonl")
