"""Metrics for Prometheus, in the text that it reads."""

from __future__ import annotations

import pytest
from prometheus_client import CollectorRegistry, generate_latest

from lndrl.errors import UserError
from lndrl.transport.status import Status, parse_status
from lndrl.view.exporter import StatusCollector, wanted_ratio

SNAPSHOT = {
    "time": 1.0,
    "steps": 2048,
    "total_steps": 9999,
    "updates": 2,
    "weights_version": 2,
    "rate": {"60s": 170.5},
    "time_split": {"wait": 0.5, "update": 0.5},
    "actor_split": {"wait": 0.0, "simulate": 1.0},
    "actors": [{"id": "a"}, {"id": "b", "state": "gone"}],
    "accounts": {"trained": {"chunks": 2, "samples": 2048}, "dropped": {"stale": {"samples": 7}}},
}


def text_of(look) -> str:
    registry = CollectorRegistry()
    registry.register(StatusCollector(look))
    return generate_latest(registry).decode()


def test_what_a_status_says_is_what_is_scraped() -> None:
    lines = text_of(lambda: parse_status(SNAPSHOT)).splitlines()
    for line in (
        "lndrl_up 1.0",
        "lndrl_steps_total 2048.0",
        "lndrl_steps_per_second 170.5",
        'lndrl_actors{state="active"} 1.0',
        'lndrl_actors{state="gone"} 1.0',
        'lndrl_samples_total{fate="trained"} 2048.0',
        'lndrl_samples_total{fate="stale"} 7.0',
        'lndrl_learner_time_ratio{activity="wait"} 0.5',
        "lndrl_actors_wanted_ratio 2.0",
    ):
        assert line in lines, line
    assert not any(line.startswith("lndrl_lag_versions ") for line in lines)


def test_a_learner_that_is_away_is_down() -> None:
    def look() -> Status:
        raise UserError("no answer")

    assert [line for line in text_of(look).splitlines() if line[0] != "#"] == ["lndrl_up 0.0"]


@pytest.mark.parametrize(
    ("learner", "actors", "wanted"),
    [(0.0, 0.0, 1.0), (0.5, 0.0, 2.0), (0.0, 0.5, 0.5), (1.0, 0.0, 4.0), (0.0, 0.99, 0.25)],
)
def test_how_many_actors_are_wanted(learner: float, actors: float, wanted: float) -> None:
    splits = {"time_split": {"wait": learner}, "actor_split": {"wait": actors}}
    assert wanted_ratio(parse_status(SNAPSHOT | splits)) == pytest.approx(wanted)


def test_before_the_first_update_nothing_is_wanted() -> None:
    assert wanted_ratio(parse_status(SNAPSHOT | {"updates": 0})) == 1.0
    assert wanted_ratio(parse_status(SNAPSHOT | {"actor_split": {}})) == 1.0
