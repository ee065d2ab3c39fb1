"""Episode records over the wire."""

from __future__ import annotations

import json

import pytest

from lndrl.navigation.episode import EpisodeRecord, EpisodeTally


def made_record() -> EpisodeRecord:
    tally = EpisodeTally()
    tally.distance = 1.5
    tally.steps = 2
    tally.sums += [60.0, 4.0, 500.0, 0.0, 0.0, -10.0, 0.4, 0.6, 1.2]
    return tally.record(3, 7, "arrived", 0.8)


def test_tally_means_and_sums() -> None:
    record = made_record()
    assert (record.world, record.episode, record.outcome, record.steps) == (3, 7, "arrived", 2)
    assert record.position_error == pytest.approx(0.2)
    assert record.angle_error == pytest.approx(0.3)
    assert record.variance_sum == pytest.approx(0.6)
    assert record.episode_return == pytest.approx(554.0)
    assert record.reward_parts["approach"] == 60.0 and record.reward_parts["step"] == -10.0


def test_round_trip_through_json() -> None:
    record = made_record()
    assert EpisodeRecord.from_dict(json.loads(json.dumps(record.to_dict()))) == record


def test_clear_starts_afresh() -> None:
    tally = EpisodeTally()
    tally.sums += 1.0
    tally.steps, tally.distance = 4, 2.0
    tally.clear()
    tally.steps += 1
    record = tally.record(0, 0, "lost", 0.4)
    assert record.steps == 1 and record.episode_return == 0.0 and record.distance == 0.0


@pytest.mark.parametrize(
    "field, value",
    [
        ("world", -1),
        ("steps", 1.5),
        ("steps", True),
        ("outcome", "won"),
        ("outcome", ["arrived"]),
        ("time", float("nan")),
        ("distance", "far"),
        ("position_error", -0.1),
        ("episode_return", float("inf")),
        ("reward_parts", {"approach": 1.0}),
        ("reward_parts", None),
    ],
)
def test_refuses_wrong_fields(field: str, value: object) -> None:
    data = {**made_record().to_dict(), field: value}
    with pytest.raises(ValueError, match=field):
        EpisodeRecord.from_dict(data)


def test_refuses_missing_or_unknown_keys() -> None:
    data = made_record().to_dict()
    for wrong in ({**data, "x": 1}, {k: v for k, v in data.items() if k != "time"}, None, [1]):
        with pytest.raises(ValueError, match="needs the keys"):
            EpisodeRecord.from_dict(wrong)  # type: ignore[arg-type]
