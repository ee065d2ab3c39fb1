from __future__ import annotations

import os

import pytest

from lndrl.bench.dashboard import live, viewer
from lndrl.bench.dashboard.crowd import history, snapshot
from lndrl.transport import ChunkHeader, Hello
from lndrl.transport.status import parse_reply


def test_the_synthetic_crowd_is_a_status() -> None:
    status, rows = parse_reply({"snapshot": snapshot(300, 7), "history": history(600)})
    assert len(status.actors) == 300 and len(rows) == 600
    assert {actor.state for actor in status.actors} == {"active", "slow", "gone"}


def test_a_viewer_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer, "SIZES", ((80, 24),))
    (figures,) = viewer.measure(1.0).values()
    assert 0.0 < figures["core_share"] < 1.5
    assert 0.0 < figures["pictures_per_second"] <= 2 * viewer.RATE + 2.0


def test_a_chunk_in_which_somebody_came_or_went_counts_for_neither() -> None:
    learner = live._Learner()
    learner.on_hello(Hello("actor-0", "first", "here", os.getpid(), 8, "0.1"))
    header = ChunkHeader("bench", "actor-0", "first", 1, 64, 8)
    for watching in (False, False, True, True, True, False):
        learner.watching = watching
        assert learner.on_chunk(header, {}, 1).status == "accepted"
    assert [seen for seen, _ in learner.chunks] == [False, True, True]
    assert len(learner.spent(True)) == 2 and all(s >= 0.0 for s in learner.spent(False))
