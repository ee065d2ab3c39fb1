from __future__ import annotations

import pytest

from lndrl.bench.dashboard import viewer
from lndrl.bench.dashboard.crowd import history, snapshot
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
