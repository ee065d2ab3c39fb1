"""Learners that die, stop, diverge, run out of disk or see the clock jump."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from learner.ppo.update import DivergedError
from learner.status import snapshot
from lndrl.errors import UserError
from lndrl.numbering import checkpoints_in
from lndrl.transport import ChunkHeader
from lndrl.transport.status import parse_status
from tests.learner.helpers_learner import random_trajectory
from tests.learner.test_learner import Run, start

assert start is not None  # the fixture


def ledger(run: Run) -> list[dict]:
    run.learner.accounts.flush()
    return [json.loads(line) for line in run.learner.folder.ledger.read_text().splitlines()]


def totals(run: Run) -> dict[str, int]:
    """Chunks by what became of them; the sum is checked."""
    told = run.learner.accounts.totals()
    dropped = {rule: tally["chunks"] for rule, tally in told["dropped"].items() if tally["chunks"]}
    waiting, trained = told["waiting"]["chunks"], told["trained"]["chunks"]
    assert told["accepted"]["chunks"] == trained + waiting + sum(dropped.values())
    return {"trained": trained, "waiting": waiting, **dropped}


def kinds(run: Run) -> list[str]:
    return [event["kind"] for event in run.learner.events.recent()]


def diverge(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def update(*_: object) -> dict[str, float]:
        raise DivergedError("loss nan with gradient norm nan")

    monkeypatch.setattr(run.learner.ppo, "update", update)


def test_every_chunk_of_a_run_is_told_of(start) -> None:
    run = start(learner={"checkpoint_interval": 2})
    run.update(2)
    run.send()
    assert totals(run) == {"trained": 4, "waiting": 1}
    words = [row["kind"] for row in ledger(run)]
    assert words == [
        "checkpoint",
        *(["accepted"] * 2 + ["trained"]) * 2,
        "checkpoint",
        "accepted",
    ]
    status = parse_status(snapshot(run.learner))
    assert (status.accounts.trained.samples, status.accounts.waiting.samples) == (64, 16)
    run.close()
    assert totals(run) == {"trained": 4, "waiting": 0, "end": 1}
    summary = json.loads((run.learner.folder.path / "summary.json").read_text())
    assert summary["accounts"] == run.learner.accounts.totals()
    assert summary["dropped"]["end"] == 1


def test_a_chunk_is_in_the_ledger_before_it_is_acknowledged(start, monkeypatch) -> None:
    run = start()
    monkeypatch.setattr(run.learner.ingest, "_ack", lambda *_: 1 / 0)
    run.send()
    assert ledger(run)[-1]["kind"] == "accepted"


def test_nothing_is_accepted_once_the_run_has_ended(start) -> None:
    run = start()
    run.update()
    run.learner.end()
    run.sequence += 1
    header = ChunkHeader(run.welcome.run_id, "a", run.incarnation, run.sequence, 8, 2)
    arrays = random_trajectory(run.learner.config, 1).to_arrays()
    assert run.learner.ingest.on_chunk(header, arrays, 100).status == "pause"
    assert totals(run) == {"trained": 2, "waiting": 0}


def test_a_killed_learner_is_followed_by_one_that_knows_what_was_lost(start) -> None:
    run = start(learner={"checkpoint_interval": 2})
    run.update(3)
    run.send()
    run.learner.close()  # as far as files go, a SIGKILL
    with run.learner.folder.ledger.open("a") as file:
        file.write('{"kind":"accepted","ac')
    again = start(resume=True)
    assert totals(again) == {"trained": 4, "waiting": 0, "restart": 3}
    assert "restart" in kinds(again) and "ledger" not in kinds(again)
    again.incarnation, again.sequence = run.incarnation, run.sequence
    for _ in range(10):
        again.update()
    assert "gap" not in kinds(again)
    assert again.learner.counters.updates == 12


def test_chunks_acted_on_weights_that_a_crash_undid_are_taken(start) -> None:
    run = start(learner={"checkpoint_interval": 2})
    run.update(3)
    run.learner.close()
    again = start(resume=True)
    again.send(version=3)
    again.send(version=4)
    assert totals(again)["waiting"] == 1 and again.learner.ingest.dropped["refused"] == 1


def test_a_run_goes_on_without_its_ledger(start) -> None:
    run = start(learner={"checkpoint_interval": 1})
    run.update(2)
    run.learner.close()
    run.learner.folder.ledger.unlink()
    again = start(resume=True)
    assert "ledger" in kinds(again)
    again.update()
    assert totals(again) == {"trained": 6, "waiting": 0}


def test_checkpoints_of_before_there_were_books_still_load(start) -> None:
    run = start(learner={"checkpoint_interval": 1})
    run.update(2)
    run.learner.close()
    run.learner.folder.ledger.unlink()
    newest = checkpoints_in(run.learner.folder.checkpoints)[-1] / "state.json"
    state = json.loads(newest.read_text())
    del state["accounts"], state["digest"], state["roster"]["next_index"]
    newest.write_text(json.dumps(state))
    again = start(resume=True)
    again.update()
    assert again.learner.counters.steps == 96
    assert "ledger" not in kinds(again)


@pytest.mark.parametrize("roster", [3, {}, {"actors": [], "sequences": []}, {"actors": {"a": "b"}}])
def test_a_roster_that_is_none_is_a_damaged_checkpoint(start, roster) -> None:
    run = start(learner={"checkpoint_interval": 1})
    run.update(2)
    run.learner.close()
    newest = checkpoints_in(run.learner.folder.checkpoints)[-1] / "state.json"
    state = json.loads(newest.read_text())
    del state["digest"]
    newest.write_text(json.dumps({**state, "roster": roster}))
    with pytest.raises(UserError, match=r"damaged.*--checkpoint step-000000032"):
        start(resume=True)
    again = start(resume=True, checkpoint="step-000000032")
    again.update()
    again.learner.checkpoint()
    names = [path.name for path in checkpoints_in(again.learner.folder.checkpoints)]
    assert names[-1] == "step-000000064"
    again.learner.close()
    assert start(resume=True).learner.counters.steps == 64, "the damaged one is out of the way"


def test_a_spoilt_update_costs_its_batch_and_the_run_goes_on(start, monkeypatch) -> None:
    run = start()
    run.update()
    weights = run.actor.fetch()
    with monkeypatch.context() as patch:
        diverge(run, patch)
        for _ in range(2):
            run.send()
            run.send()
            assert not run.learner.advance(timeout=0.0)
    assert totals(run) == {"trained": 2, "waiting": 0, "diverged": 4}
    assert (run.learner.counters.updates, run.learner.counters.steps) == (1, 32)
    assert run.actor.fetch() == weights
    assert kinds(run).count("diverged") == 2
    run.update()
    assert run.learner.counters.updates == 2 and run.learner._failures == 0


def test_three_in_a_row_end_the_run_and_leave_the_disk_alone(start, monkeypatch) -> None:
    run = start(learner={"checkpoint_interval": 1})
    run.update(2)
    before = {p: p.read_bytes() for p in run.learner.folder.checkpoints.rglob("*") if p.is_file()}
    diverge(run, monkeypatch)
    with pytest.raises(UserError, match=r"3 times in a row.*step-000000064 is intact"):
        for _ in range(3):
            run.send()
            run.send()
            run.learner.advance(timeout=0.0)
    after = {p: p.read_bytes() for p in run.learner.folder.checkpoints.rglob("*") if p.is_file()}
    assert before == after
    assert totals(run)["diverged"] == 6


def test_lockstep_cannot_skip_a_round(start, monkeypatch) -> None:
    run = start(learner={"mode": "lockstep"}, actor={"count": 1})
    diverge(run, monkeypatch)
    run.send()
    with pytest.raises(UserError, match="diverged"):
        run.learner.advance(timeout=0.0)


def test_a_real_spoilt_batch_changes_no_weight(start) -> None:
    run = start()
    run.update()
    before = [p.detach().clone() for p in run.learner.ppo.policy.parameters()]
    for _ in range(2):
        run.send()
    for chunk in run.learner.ingest._queue._chunks:
        rewards = np.full_like(chunk.trajectory.reward, np.nan)
        object.__setattr__(chunk, "trajectory", replace(chunk.trajectory, reward=rewards))
    assert not run.learner.advance(timeout=0.0)
    assert totals(run)["diverged"] == 2
    for one, other in zip(before, run.learner.ppo.policy.parameters(), strict=True):
        assert bool((one == other).all())


def test_a_disk_that_takes_nothing_stops_nothing(start, monkeypatch, tmp_path: Path) -> None:
    run = start(learner={"checkpoint_interval": 1})
    run.update()

    def refuse(*_: object, **__: object) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("learner.run.lines.os.write", refuse)
        patch.setattr("learner.run.checkpoint.os.fsync", refuse)
        patch.setattr(Path, "write_text", refuse)
        patch.setattr("torch.utils.tensorboard.SummaryWriter.add_scalar", refuse)
        run.update(3)
        run.learner.end()
    monkeypatch.setattr("learner.run.lines._RETRY", 0.0)
    texts = " ".join(event["text"] for event in run.learner.events.recent())
    for name in ("events.log", "ledger.jsonl", "metrics.jsonl", "tensorboard", "summary.json"):
        assert f"{name}" in texts
    run.learner.ingest.shut = False
    run.update()
    assert totals(run) == {"trained": 10, "waiting": 0}
    words = [row["kind"] for row in ledger(run)]
    assert words.count("trained") == 5, "what waited in memory was written"
    assert "written again" in " ".join(e["text"] for e in run.learner.events.recent())


def test_the_clock_may_jump(start, monkeypatch) -> None:
    run = start()
    run.update()
    run.learner.checkpoint()
    for jump in (-1e9, -3600.0, 3600.0, 1e9, -4e9):
        real = time.time
        with monkeypatch.context() as patch:
            patch.setattr("time.time", lambda real=real, jump=jump: real() + jump)
            status = parse_status(snapshot(run.learner))
            run.update()
        saved, heard = status.checkpoint, status.actors[0].last_ack_age
        assert saved is not None and saved.age is not None and 0 <= saved.age < 600
        assert status.uptime < 600 and status.actors[0].state == "active"
        assert heard is not None and 0 <= heard < 600
        assert status.verdict in ("learning", "balanced", "actor-bound", "learner-bound")


def test_a_silent_actor_is_slow_by_its_own_rhythm(start, monkeypatch) -> None:
    run = start(ppo={"batch_size": 4096, "minibatch_size": 16})
    now = [1000.0]
    monkeypatch.setattr("learner.intake.roster.time.monotonic", lambda: now[0])
    run.learner.roster._members.clear()

    def state() -> str:
        return run.learner.roster.rows(0)[0]["state"]

    for _ in range(20):
        now[0] += 2.0
        run.send()
    now[0] += 6.9
    assert state() == "active"
    now[0] += 0.2
    assert state() == "slow", "5 s and its rhythm of 2 s"
    run.send()
    assert state() == "active"


def test_a_frozen_actor_stays_gone_though_its_last_chunks_arrive(start) -> None:
    run = start(ppo={"batch_size": 4096, "minibatch_size": 16})
    ingest, roster = run.learner.ingest, run.learner.roster
    run.send()
    ingest.on_member("a", run.incarnation, False)
    for expected in ("gone", "gone", "active"):
        run.send()
        assert roster.rows(0)[0]["state"] == expected, "a window of uploads was on its way"
    ingest.on_member("a", run.incarnation, False)
    ingest.on_member("a", run.incarnation, True)
    assert roster.rows(0)[0]["state"] == "active"


def test_a_flood_of_refusals_is_a_few_lines(start) -> None:
    run = start()
    for n in range(1000):
        header = ChunkHeader("another run", "liar", "x", n, 8, 2)
        assert run.learner.ingest.on_chunk(header, {}, 100).status == "refused"
    run.learner.events.close()
    lines = run.learner.folder.events.read_text().splitlines()
    assert sum("liar" in line for line in lines) == 4
    assert "997 more, of liar" in lines[-1]
    assert run.learner.ingest.dropped["refused"] == 1000
