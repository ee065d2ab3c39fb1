"""Thousands of malformed messages against the learner's real door, in this process.

Every one must end in an answer: none may raise, be taken for an upload, or keep anything.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from learner.intake.ingest import Ingest
from learner.intake.roster import Roster
from learner.run.events import EventLog
from lndrl.chaos.forged import forged_arrays, forged_header, forged_hello
from lndrl.chaos.messages import Forger, Malformed
from lndrl.config import RunConfig, load_config
from lndrl.transport import Ack, ChunkHeader, Limits, Refusal, Welcome
from lndrl.transport.desk import LearnerDesk
from lndrl.transport.messages import decode, encode

ROOT = Path(__file__).resolve().parents[2]
MESSAGES = 6000
VERSION = 5


@pytest.fixture(scope="module")
def config() -> RunConfig:
    changes = ("scenario=sparse", "transport.upload_timeout=0.02", "ppo.batch_size=64")
    return load_config(
        ROOT / "configs/lndrl.yaml", [*changes, "ppo.minibatch_size=64", "actor.horizon=4"]
    )


class Door:
    """Desk and ingest as a learner has them; what they accept is taken away at once."""

    def __init__(self, config: RunConfig, folder: Path | None = None) -> None:
        path = None if folder is None else folder / "events.log"
        self.desk = LearnerDesk(Limits(max_bytes=16 * 2**20))
        events = EventLog(path, quiet=True)
        self.ingest = Ingest(config, "run", self.desk.incarnation, Roster(), events)
        self.ingest.weights_version = VERSION
        self.desk.handlers = self.ingest
        self.desk.put_weights(VERSION, b"weights")

    def answer(self, message: Malformed) -> str:
        """Status of the answer to an upload or a hello."""
        if message.kind == "hello":
            found, _ = decode(self.desk.answer_hello(message.payload), Welcome, Refusal)
            return found.KIND
        ack, arrays = decode(encode(self.desk.answer_chunk(message.payload)), Ack)
        assert not arrays
        self.ingest.take(1, timeout=0.0)
        return ack.status


def aimed(message: Malformed) -> bool:
    return message.way == "query" and message.kind in ("upload", "hello")


def test_an_honest_upload_is_taken(config: RunConfig) -> None:
    door = Door(config)
    forger = Forger(config, "run", VERSION)
    ack, _ = decode(encode(door.desk.answer_chunk(forger.valid())), Ack)
    assert (ack.status, ack.reason) == ("accepted", "")
    welcome, _ = decode(door.desk.answer_hello(encode(forged_hello("a", "x"))), Welcome)
    assert welcome.run_id == "run"


def test_no_malformed_message_is_taken_or_raises(config: RunConfig, tmp_path: Path) -> None:
    door = Door(config, tmp_path)
    forger = Forger(config, "run", VERSION, seed=1)
    answers: Counter[str] = Counter()
    taken = []
    for _ in range(MESSAGES):
        message = forger.draw()
        if not aimed(message):
            continue
        status = door.answer(message)
        answers[status] += 1
        if message.hopeless and status not in ("refused", "refusal"):
            taken.append((message.what, status))
    assert taken == []
    assert answers["refused"] > MESSAGES / 3
    assert answers["refusal"] > MESSAGES / 20
    valid, _ = decode(encode(door.desk.answer_chunk(forger.valid())), Ack)
    assert valid.status == "accepted", "the door still works"


def test_the_material_repeats_by_seed_and_is_of_every_kind(config: RunConfig) -> None:
    one, other = (Forger(config, "run", VERSION, seed=3) for _ in range(2))
    messages = [one.draw() for _ in range(400)]
    assert messages == [other.draw() for _ in range(400)]
    assert {m.way for m in messages} == {"query", "put", "token"}
    assert {"upload", "hello", "weights", "status", "actors"} <= {m.kind for m in messages}


@settings(max_examples=300)
@given(st.binary(max_size=300))
def test_any_bytes_are_answered(data: bytes) -> None:
    door = DOORS.setdefault("door", Door(CONFIG))
    assert decode(encode(door.desk.answer_chunk(data)), Ack)[0].status == "refused"
    assert decode(door.desk.answer_hello(data), Refusal)[0].reason


JSONISH: Any = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=8,
)


@settings(max_examples=300)
@given(
    st.sampled_from(
        ["run_id", "actor_id", "incarnation", "steps", "worlds", "episodes", "timing", "pid"]
    ),
    JSONISH,
)
def test_any_field_of_any_value_is_answered(name: str, value: Any) -> None:
    from lndrl.transport import MessageError, pack

    door = DOORS.setdefault("door", Door(CONFIG))
    header = forged_header("run", "field", "x", 1, 8).to_dict() | {name: value}
    arrays = forged_arrays(CONFIG, np.random.default_rng(0))
    try:
        data = pack({"kind": "chunk", "body": header}, arrays)
    except MessageError:
        return
    status = decode(encode(door.desk.answer_chunk(data)), Ack)[0].status
    door.ingest.take(1, timeout=0.0)
    assert status in ("accepted", "duplicate", "refused", "pause")


@settings(max_examples=200)
@given(st.integers(0, 2**32), st.data())
def test_any_flipped_bits_of_an_upload_are_answered(seed: int, data: st.DataObject) -> None:
    door = DOORS.setdefault("door", Door(CONFIG))
    payload = bytearray(WHOLE)
    for place in data.draw(st.lists(st.integers(0, len(payload) * 8 - 1), min_size=1, max_size=6)):
        payload[place // 8] ^= 1 << place % 8
    decode(encode(door.desk.answer_chunk(bytes(payload))), Ack)
    door.ingest.take(1, timeout=0.0)


DOORS: dict[str, Door] = {}
CONFIG = load_config(
    ROOT / "configs/lndrl.yaml",
    ["scenario=sparse", "transport.upload_timeout=0.02", "actor.horizon=8"],
)
WHOLE = encode(
    ChunkHeader("run", "flip", "x", 1, 8, 1), forged_arrays(CONFIG, np.random.default_rng(1))
)
