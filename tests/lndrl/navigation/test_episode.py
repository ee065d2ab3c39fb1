"""Episode records over the wire."""

from __future__ import annotations

import json

import pytest

from lndrl.navigation.episode import EpisodeRecord, EpisodeTally
from lndrl.navigation.track import make_tracks, track_of


def made_record() -> EpisodeRecord:
    track = track_of(make_tracks(1, 4, 5), 0)
    track.distance[0] = 1.5
    track.steps[0] = 2
    tally = EpisodeTally(track)
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
