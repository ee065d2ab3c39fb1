"""A job of two ranks from its start to its end, and what a run is after it."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from learner.intake.accounts import summed
from learner.learner import Learner
from learner.run.checkpoint import find_checkpoint
from learner.status import snapshot
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.transport import UNKNOWN_ACTOR, Ack, ChunkHeader, open_learner
from lndrl.transport.messages import decode, encode
from lndrl.transport.status import parse_status
from lndrl.transport.zenoh.session import open_connecting
from tests.learner.ranks.helpers_ranks import NAMES, Feeder, job, ranks_config


def kinds(folder: Path) -> list[str]:
    """Of the ledger's lines."""
    return [json.loads(line)["kind"] for line in (folder / "ledger.jsonl").read_text().splitlines()]


def lost_its_way(config: RunConfig, feeder: Feeder) -> Ack:
    """What is answered to an upload in no lane, of an actor that has not heard of any."""
    session = open_connecting(config.transport.endpoint, config.transport, 10.0)
    try:
        header = ChunkHeader(feeder.welcome.run_id, feeder.name, "life", 9, 8, 2)
        sample = session.query(f"lndrl/upload/{feeder.name}/life/9", encode(header, {}), 10.0)
        assert sample is not None
        return decode(sample.payload.to_bytes(), Ack)[0]
    finally:
        session.close()


def check_sum(totals: dict) -> None:
    parts = [totals["trained"], totals["waiting"], *totals["dropped"].values()]
    for unit in ("chunks", "samples"):
        assert totals["accepted"][unit] == sum(part[unit] for part in parts)


def test_two_ranks_train_one_run_which_one_rank_goes_on_with(tmp_path: Path) -> None:
    config, path = ranks_config(), tmp_path / "run"
    with job(config, path) as (made, _):
        learner = made.learner
        feeders = [Feeder(config, name) for name in NAMES]
        assert [feeder.welcome.lane for feeder in feeders] == ["rank-0", "rank-1"]
        for version in range(3):
            made.update(feeders, version)
        assert learner.counters.steps == 3 * 32 and learner.counters.version == 3
        assert lost_its_way(config, feeders[1]).reason == UNKNOWN_ACTOR, "it says hello then"
        # Sent again, it is known to the rank that has it.
        assert feeders[1].send(3, sequence=3) == "duplicate"
        assert feeders[1].send(3, sequence=4) == "accepted"
        time.sleep(1.1)  # until the next report
        assert not learner.advance(timeout=0.0)
        status = parse_status(snapshot(learner))
        totals = learner.whole.accounts()
        check_sum(totals)
        assert totals["accepted"]["chunks"] == 7 and totals["waiting"]["chunks"] == 1
        rows = {actor.id: actor for actor in status.actors}
        assert {name: rows[name].steps for name in NAMES} == {NAMES[0]: 48, NAMES[1]: 64}
        assert learner.whole.dropped()["duplicate"] == 1
        learner.end()
        end = learner.summary().accounts
        check_sum(end)
        assert end["trained"]["chunks"] == 6 and end["dropped"]["end"]["chunks"] == 1
        for feeder in feeders:
            feeder.endpoint.close()
    assert not list(path.glob("ledger.rank-*")), "all of it is in the ledger"
    said = kinds(path)
    assert said.count("accepted") == 7 and said.count("trained") == 6

    door = open_learner(config.transport)
    alone = Learner(config, path, door, resume=True, quiet=True)
    try:
        alone.begin()
        assert alone.counters.steps == 96
        # What was dropped at the end is nothing that the learner lost.
        assert alone.accounts.totals() == end
        assert not [e for e in alone.events.recent() if e["kind"] in ("restart", "ledger")]
        feeder = Feeder(config, NAMES[1])
        assert feeder.welcome.lane == ""
        assert feeder.send(3, sequence=2) == "duplicate"
        assert feeder.send(3, sequence=5) == feeder.send(3, sequence=6) == "accepted"
        assert alone.advance(timeout=5.0)
        check_sum(alone.accounts.totals())
        feeder.endpoint.close()
        alone.end()
    finally:
        alone.close()
        door.close()


def test_a_rank_that_dies_ends_the_job_in_a_sentence_and_its_chunks_are_told(tmp_path) -> None:
    config, path = ranks_config(), tmp_path / "run"
    with pytest.raises(UserError, match=r"rank 1 on \S+ is gone; the job ends here"):  # noqa: SIM117
        with job(config, path) as (made, ranks):
            feeders = [Feeder(config, name) for name in NAMES]
            for version in range(2):
                made.update(feeders, version)  # the second one leaves a checkpoint
            made.update(feeders, 2)
            ranks._children[0].kill()
            for feeder in feeders:
                feeder.endpoint.close()
            for _ in range(10):
                made.learner.advance(timeout=0.2)
    assert list(path.glob("ledger.rank-1.jsonl")), "what rank 0 had not heard of"
    assert find_checkpoint(path / "checkpoints", None).name == "step-000000064"

    with job(config, path, resume=True) as (again, _):
        totals = again.learner.accounts.totals()
        check_sum(totals)
        assert totals["accepted"]["chunks"] == 6 and totals["trained"]["chunks"] == 4
        assert totals["dropped"]["restart"]["chunks"] == 2
        feeders = [Feeder(config, name) for name in NAMES]
        # Whoever never heard that it was lost may send it again.
        assert [feeder.send(2, sequence=3) for feeder in feeders] == ["accepted"] * 2
        assert again.learner.advance(timeout=20.0)
        for feeder in feeders:
            feeder.endpoint.close()
        again.learner.end()
        check_sum(again.learner.summary().accounts)
    assert not list(path.glob("ledger.rank-*"))
    assert summed([totals]) == totals
