"""What the learner accepts, keeps, drops and refuses."""

from __future__ import annotations

import json
import threading
import time
from typing import Any

import pytest

from learner.intake.ingest import Ingest
from learner.intake.roster import Roster
from learner.intake.sequences import Sequences
from learner.run.events import EventLog
from lndrl.transport import ChunkHeader, Hello, Refusal, Welcome
from lndrl.version import VERSION
from tests.learner.helpers_learner import random_trajectory, small_config


def make_ingest(**changes) -> Ingest:
    config = small_config(**changes)
    return Ingest(config, "run-1", "life-1", Roster(), EventLog(None, quiet=True))


def header(actor: str = "a", sequence: int = 1, run_id: str = "run-1", **changes) -> ChunkHeader:
    fields: dict[str, Any] = {
        "run_id": run_id,
        "actor_id": actor,
        "incarnation": "x",
        "sequence": sequence,
        "steps": 8,
        "worlds": 2,
    }
    return ChunkHeader(**(fields | changes))


def send(ingest: Ingest, seed: int = 1, version: int = 0, **fields):
    arrays = random_trajectory(ingest.config, seed, version=version).to_arrays()
    return ingest.on_chunk(header(**fields), arrays, 1000)


def hello(**changes) -> Hello:
    fields: dict[str, Any] = {
        "actor_id": "a",
        "incarnation": "x",
        "host": "h",
        "pid": 1,
        "worlds": 2,
    }
    return Hello(**(fields | {"program_version": VERSION} | changes))


def test_hello_hands_out_the_configuration_and_a_lasting_index() -> None:
    ingest = make_ingest()
    first = ingest.on_hello(hello())
    assert isinstance(first, Welcome)
    assert first.config == ingest.config.model_dump(mode="json")
    second = ingest.on_hello(hello(actor_id="b"))
    again = ingest.on_hello(hello(incarnation="y"))
    assert isinstance(second, Welcome)
    assert isinstance(again, Welcome)
    assert (first.actor_index, second.actor_index, again.actor_index) == (0, 1, 0)


def test_other_program_version_is_refused_with_both_versions() -> None:
    refusal = make_ingest().on_hello(hello(program_version="9.9.9"))
    assert isinstance(refusal, Refusal)
    assert "9.9.9" in refusal.reason
    assert VERSION in refusal.reason


def test_a_chunk_sent_again_is_trained_on_once() -> None:
    ingest = make_ingest()
    assert send(ingest).status == "accepted"
    assert send(ingest).status == "duplicate"
    assert ingest.waiting()["chunks"] == 1
    assert ingest.dropped["duplicate"] == 1


def test_chunks_may_overtake_one_another() -> None:
    ingest = make_ingest()
    statuses = [send(ingest, sequence=n).status for n in (2, 1, 2, 1)]
    assert statuses == ["accepted", "accepted", "duplicate", "duplicate"]


def test_refused_chunks_name_the_reason_and_are_not_kept() -> None:
    ingest = make_ingest()
    assert "run-2" in send(ingest, run_id="run-2").reason
    arrays = random_trajectory(ingest.config, 1).to_arrays()
    arrays["reward"][0, 0] = float("nan")
    ack = ingest.on_chunk(header(), arrays, 1000)
    assert (ack.status, "reward" in ack.reason) == ("refused", True)
    assert ingest.waiting()["chunks"] == 0
    assert ingest.dropped["refused"] == 2


def test_take_waits_for_enough_samples_and_keeps_the_rest() -> None:
    ingest = make_ingest(ppo={"batch_size": 32, "minibatch_size": 16})
    send(ingest, sequence=1)
    assert ingest.take(32, timeout=0.0) is None
    send(ingest, sequence=2)
    chunks = ingest.take(32, timeout=0.0)
    assert chunks is not None
    assert [chunk.sequence for chunk in chunks] == [1, 2]
    assert ingest.waiting() == {"chunks": 0, "megabytes": 0.0}


def test_old_chunks_are_dropped_and_counted() -> None:
    ingest = make_ingest(learner={"max_lag": 2})
    ingest.weights_version = 4
    send(ingest, sequence=1, version=1)
    send(ingest, sequence=2, version=3)
    chunks = ingest.take(16, timeout=0.0)
    assert chunks is not None
    assert [chunk.sequence for chunk in chunks] == [2]
    assert ingest.dropped["stale"] == 1


def test_a_full_queue_makes_the_sender_wait_until_there_is_room() -> None:
    ingest = make_ingest(transport={"upload_timeout": 240.0})
    for n in (1, 2):
        send(ingest, sequence=n)
    answers = []
    sender = threading.Thread(target=lambda: answers.append(send(ingest, sequence=3).status))
    sender.start()
    time.sleep(0.2)
    assert not answers
    ingest.take(32, timeout=0.0)
    sender.join(timeout=60.0)
    assert answers == ["accepted"]


def test_a_sender_that_waits_too_long_is_told_to_pause() -> None:
    ingest = make_ingest(transport={"upload_timeout": 0.2})
    for n in (1, 2):
        send(ingest, sequence=n)
    assert send(ingest, sequence=3).status == "pause"
    assert send(ingest, sequence=3).status == "pause"
    ingest.take(32, timeout=0.0)
    assert send(ingest, sequence=3).status == "accepted"


def test_lockstep_takes_one_chunk_of_each_actor_in_their_order() -> None:
    ingest = make_ingest(learner={"mode": "lockstep"})
    for actor in ("a", "b"):
        ingest.on_hello(hello(actor_id=actor))
    send(ingest, actor="b", sequence=1)
    send(ingest, actor="b", sequence=2)
    assert ingest.take_round(2, timeout=0.0) is None
    send(ingest, actor="a", sequence=1)
    chunks = ingest.take_round(2, timeout=0.0)
    assert chunks is not None
    assert [(c.actor_index, c.sequence) for c in chunks] == [(0, 1), (1, 1)]
    assert ingest.waiting()["chunks"] == 1


def test_done_is_said_to_everybody() -> None:
    ingest = make_ingest()
    ingest.finish()
    assert isinstance(ingest.on_hello(hello()), Refusal)
    assert send(ingest).done


def test_sequences_give_up_holes_only_after_the_window() -> None:
    known = Sequences()
    assert known.add(2) == 0
    assert 1 not in known
    lost = sum(known.add(n) for n in range(3, 30))
    assert lost == 1
    assert known.beyond == set()
    # To take for known what comes after it was given up would acknowledge and lose it.
    assert 1 not in known and 2 in known
    assert known.add(1) == 0
    assert 1 in known and known.holes == []


def test_a_chunk_that_was_given_up_is_accepted_when_it_comes_after_all() -> None:
    ingest = make_ingest(ppo={"batch_size": 10**6, "minibatch_size": 16})
    for sequence in (*range(1, 4), *range(5, 30)):
        send(ingest, sequence=sequence)
    assert ingest.gaps == 1
    restored = Roster()
    restored.restore(json.loads(json.dumps(ingest.roster.to_state())))
    assert not restored.is_known("a", "x", 4) and restored.is_known("a", "x", 3)
    assert send(ingest, sequence=4).status == "accepted"
    assert send(ingest, sequence=4).status == "duplicate"


def test_roster_state_survives_a_checkpoint() -> None:
    ingest = make_ingest()
    send(ingest, actor="a", sequence=1)
    send(ingest, actor="b", sequence=3)
    restored = Roster()
    restored.restore(ingest.roster.to_state())
    assert restored.is_known("a", "x", 1)
    assert not restored.is_known("a", "x", 2)
    assert restored.is_known("b", "x", 3)
    assert not restored.is_known("b", "x", 1)
    assert restored.counts() == (0, 2)
    again = restored.join("b", "y", "h", 1, 2)
    assert again is not None and again.index == 1


@pytest.mark.parametrize("alive", [True, False])
def test_liveliness_is_noted_once(alive: bool) -> None:
    roster = Roster()
    roster.join("a", "x", "h", 1, 2)
    assert roster.gone("a", "x", alive) is (not alive)
    assert not roster.gone("a", "other life", not alive)


def test_times_of_actors_are_summed_up() -> None:
    """Shares per actor and together, known activities only, and no time below zero."""
    ingest = make_ingest()
    send(ingest, actor="a", sequence=1, timing={"simulate": 3.0, "wait": 1.0})
    send(ingest, actor="b", sequence=1, timing={"infer": 4.0, "dreams": 9.0, "wait": -7.0})
    roster = ingest.roster
    assert roster.totals() == {"simulate": 3.0, "infer": 4.0, "wait": 1.0}
    assert roster.shares() == {"simulate": 3 / 8, "infer": 4 / 8, "wait": 1 / 8}
    assert roster.steps() == 32
    a, b = (row["time_split"] for row in roster.rows(0))
    assert a == {"simulate": 0.75, "wait": 0.25} and b == {"infer": 1.0, "wait": 0.0}
    roster.gone("a", "x", False)
    assert roster.shares() == {"infer": 1.0, "wait": 0.0}, "of those who live"
    assert roster.totals()["simulate"] == 3.0


def test_shares_are_of_the_newest_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    ingest = make_ingest(ppo={"batch_size": 1024, "minibatch_size": 16})
    now = 100.0
    monkeypatch.setattr("learner.intake.roster.time.monotonic", lambda: now)
    for sequence, name in enumerate(("simulate", "infer", "wait"), 1):
        now += 20.0
        send(ingest, sequence=sequence, timing={name: 20.0})
    assert ingest.roster.shares(30.0) == {"infer": 0.5, "wait": 0.5}
    assert ingest.roster.shares() == {"simulate": 1 / 3, "infer": 1 / 3, "wait": 1 / 3}
    now += 1000.0
    assert ingest.roster.shares(30.0) == {"wait": 1.0}, "the last word of a silent actor"


def test_actors_taken_away_leave_the_rows() -> None:
    ingest = make_ingest(ppo={"batch_size": 1024, "minibatch_size": 16})
    for actor in ("a", "b"):
        send(ingest, actor=actor)
    ingest.roster.retire("b")
    assert [row["state"] for row in ingest.roster.rows(0)] == ["active", "active"]
    assert send(ingest, actor="b", sequence=2).status == "accepted", "it was on its way"
    for actor in ("a", "b"):
        ingest.on_member(actor, "x", False)
    assert [(row["id"], row["state"]) for row in ingest.roster.rows(0)] == [("a", "gone")]
    ingest.on_hello(hello(actor_id="b", incarnation="y"))
    ingest.on_member("b", "y", False)
    assert [row["state"] for row in ingest.roster.rows(0)] == ["gone", "gone"]
