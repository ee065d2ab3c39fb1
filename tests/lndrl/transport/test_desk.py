"""What a learner's desk says of the status, however often it is asked."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from lndrl.transport import Limits, desk
from lndrl.transport.desk import LearnerDesk, to_json


def test_rows_of_the_history_are_encoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    encoded: list[Any] = []

    def counting(value: Any) -> bytes:
        encoded.append(value)
        return to_json(value)

    monkeypatch.setattr(desk, "to_json", counting)
    keeper = LearnerDesk(Limits())
    assert keeper.status() is None
    history = [{"steps": n, "kl": math.nan if n == 3 else 0.5} for n in range(50)]
    for last in range(10):
        keeper.put_status({"updates": last}, history)
        told = json.loads(keeper.status() or b"")
        assert told["snapshot"] == {"updates": last}
        assert [row["steps"] for row in told["history"]] == [row["steps"] for row in history]
        assert told["history"][3 - last if last <= 3 else 0]["kl"] == (None if last <= 3 else 0.5)
        history = [*history[1:], {"steps": 50 + last, "kl": 0.5}]
    assert sum("steps" in value for value in encoded) == 50 + 9
    assert len(keeper._rows) == 50


def test_a_status_without_history_is_whole() -> None:
    keeper = LearnerDesk(Limits())
    keeper.put_status({"updates": 0}, [])
    assert json.loads(keeper.status() or b"") == {"snapshot": {"updates": 0}, "history": []}
