"""Who goes first, who waits, and that refusing stays within its share whatever comes."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

import pytest

from lndrl.config import TransportConfig
from lndrl.transport import uploads
from lndrl.transport.uploads import CAPACITY, PER_STRANGER, REFUSING, UploadQueue


@dataclass
class Letter:
    """As much of a query as the queue looks at."""

    key_expr: str
    payload: bytes = b"12345"
    dropped: list[bool] = field(default_factory=list)

    def drop(self) -> None:
        self.dropped.append(True)


class Room:
    """A queue and the time in it."""

    def __init__(self) -> None:
        self.now = 100.0
        self.queue: UploadQueue[Letter] = UploadQueue(lambda: self.now)

    def put(self, sender: str, sequence: int = 1, payload: bytes = b"12345") -> Letter:
        letter = Letter(f"lndrl/upload/{sender}/life/{sequence}", payload)
        self.queue.put(letter)
        return letter

    def get(self) -> str:
        """Sender and sequence of the next."""
        letter = self.queue.get()
        assert letter is not None
        parts = letter.key_expr.split("/")
        return f"{parts[2]} {parts[4]}"

    def answer(self, sender: str, status: str, seconds: float = 0.001) -> None:
        self.queue.settle(Letter(f"lndrl/upload/{sender}/life/0"), status, seconds)

    def is_idle(self) -> bool:
        """Whether ``get`` waits."""
        got: list[Letter | None] = []
        thread = threading.Thread(target=lambda: got.append(self.queue.get()), daemon=True)
        thread.start()
        thread.join(0.05)
        idle = not got
        if idle:
            self.queue.close()
            thread.join(60.0)
        return idle


def test_uploads_come_out_in_the_order_of_their_coming_and_each_once():
    room = Room()
    first = room.put("a", 1)
    room.put("a", 2)
    again = room.put("a", 1)
    assert first.dropped and not again.dropped
    assert [room.get(), room.get()] == ["a 1", "a 2"]
    assert room.is_idle()


def test_strangers_take_turns():
    room = Room()
    for sequence in (1, 2, 3):
        room.put("flood", sequence)
    room.put("newcomer")
    assert [room.get() for _ in range(4)] == ["flood 1", "newcomer 1", "flood 2", "flood 3"]


def test_whoever_delivered_goes_ahead_and_never_waits():
    room = Room()
    room.answer("honest", "accepted")
    room.answer("liar", "refused", seconds=1.0)
    room.put("liar")
    room.put("honest")
    assert room.get() == "honest 1"
    room.put("honest", 2)
    assert room.get() == "honest 2"
    assert room.is_idle()


def test_refusing_takes_no_more_than_its_share():
    room = Room()
    spent = 0.0
    began = room.now
    for sequence in range(200):
        room.put("liar", sequence)
        while room.now < room.queue._open_at:
            room.now += 0.001
        assert room.get() == f"liar {sequence}"
        cost = 0.0001 * (1 + sequence % 7)
        spent += cost
        room.answer("liar", "refused", cost)
    assert spent / (room.queue._open_at - began) == pytest.approx(REFUSING, rel=0.1)


def test_a_cheap_refusal_does_not_pay_for_a_dear_one():
    room = Room()
    room.answer("honest", "accepted")
    room.answer("liar", "refused", seconds=1.0)
    room.answer("honest", "refused", seconds=0.001)
    assert room.queue._open_at - room.now == pytest.approx(1.001 / REFUSING)


def test_a_refusal_costs_the_trust_and_what_waits_goes_to_the_other_lane():
    room = Room()
    room.answer("turncoat", "accepted")
    for sequence in (1, 2):
        room.put("turncoat", sequence)
    room.answer("turncoat", "refused")
    room.answer("honest", "accepted")
    room.put("honest")
    assert room.get() == "honest 1"
    room.now += 1.0
    assert room.get() == "turncoat 1"
    room.answer("turncoat", "accepted")
    room.answer("liar", "refused", seconds=1.0)
    assert room.get() == "turncoat 2"
    assert room.queue._strangers_count == room.queue._strangers_bytes == 0


def test_duplicates_pauses_and_stale_ones_change_nothing():
    room = Room()
    for status in ("duplicate", "pause", "stale"):
        room.answer("a", status, seconds=10.0)
    room.put("a")
    assert room.get() == "a 1"
    assert not room.queue._trusted


def test_one_stranger_cannot_fill_the_room():
    room = Room()
    letters = [room.put("flood", sequence) for sequence in range(PER_STRANGER + 5)]
    assert [bool(letter.dropped) for letter in letters] == [False] * PER_STRANGER + [True] * 5
    assert not room.put("newcomer").dropped


def test_neither_many_strangers_nor_large_uploads_fill_the_memory(
    monkeypatch: pytest.MonkeyPatch,
):
    room = Room()
    kept = [room.put(f"s{number}") for number in range(CAPACITY + 10)]
    assert sum(not letter.dropped for letter in kept) == CAPACITY
    assert len(room.queue._strangers) == CAPACITY
    monkeypatch.setattr(uploads, "STRANGERS_BYTES", 100)
    other = Room()
    assert not other.put("a", 1, bytes(60)).dropped
    assert other.put("b", 1, bytes(60)).dropped
    assert not other.put("a", 1, bytes(90)).dropped
    assert other.put("a", 1, bytes(110)).dropped
    assert other.get() == "a 1"
    assert not other.put("b", 1, bytes(60)).dropped


def test_trust_is_bounded():
    room = Room()
    for number in range(CAPACITY + 3):
        room.answer(f"s{number}", "accepted")
    assert len(room.queue._trusted) == CAPACITY
    assert "lndrl/upload/s2/life" not in room.queue._trusted


def test_closing_wakes_whoever_waits_and_later_uploads_are_left():
    room = Room()
    got: list[Letter | None] = [Letter("x")]
    thread = threading.Thread(target=lambda: got.append(room.queue.get()))
    thread.start()
    room.queue.close()
    thread.join(60.0)
    assert not thread.is_alive() and got[-1] is None
    assert room.put("a").dropped
    assert not room.queue._strangers


def test_the_largest_upload_that_a_learner_may_allow_finds_room_alone():
    """One that no lane had room for would be sent again for ever."""
    largest = uploads.STRANGERS_BYTES // 2**20
    assert TransportConfig(max_message_megabytes=largest)
    with pytest.raises(ValueError, match=f"less than or equal to {largest}"):
        TransportConfig(max_message_megabytes=largest + 1)
    assert TransportConfig(upload_window=16).upload_window <= PER_STRANGER
    with pytest.raises(ValueError, match="less than or equal to 16"):
        TransportConfig(upload_window=17)
