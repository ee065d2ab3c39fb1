from __future__ import annotations

import math
from typing import Any

import pytest

from lndrl.errors import UserError
from lndrl.transport.status import (
    ACTOR_ACTIVITIES,
    LEARNER_ACTIVITIES,
    VERDICTS,
    WORK,
    balance_word,
    overhead,
    parse_history,
    parse_reply,
    parse_status,
    shares_of,
)

LEAST: dict[str, Any] = {"time": 1.0, "steps": 5, "total_steps": 10}


def test_least_status_has_defaults() -> None:
    status = parse_status(LEAST)
    assert (status.steps, status.total_steps, status.actors, status.eta) == (5, 10, [], None)


def test_keys_of_newer_versions_are_ignored() -> None:
    newer = LEAST | {"mood": 3, "rate": {"10s": 2.0, "1h": 9.0}, "actors": [{"id": "a", "x": 1}]}
    status = parse_status(newer)
    assert status.rate.seconds_10 == 2.0
    assert status.actors[0].id == "a"


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"steps": -1}, "steps"),
        ({"steps": "many"}, "steps"),
        ({"time": math.nan}, "time"),
        ({"rate": {"10s": -3.0}}, "rate.10s"),
        ({"episodes": {"arrived": 1.4}}, "episodes.arrived"),
        ({"actors": [{"host": "nameless"}]}, "actors.0.id"),
        ({"actors": {"id": "a"}}, "actors"),
        ({"time_split": {"update": 7.0}}, "time_split.update"),
    ],
)
def test_nonsense_is_refused_by_name(change: dict[str, Any], key: str) -> None:
    with pytest.raises(UserError, match=rf"^status: {key}\b"):
        parse_status(LEAST | change)


def test_missing_key_is_named() -> None:
    with pytest.raises(UserError, match="total_steps is missing"):
        parse_status({"time": 1.0, "steps": 5})


def test_nan_means_unknown_for_episodes_but_stays_in_ppo() -> None:
    status = parse_status(LEAST | {"episodes": {"arrived": math.nan}, "ppo": {"kl": math.nan}})
    assert status.episodes.arrived is None
    assert status.ppo.kl is not None and math.isnan(status.ppo.kl)


def test_history_names_the_row() -> None:
    rows = parse_history([{"time": 1.0, "steps": 3, "arrived": None, "new": 1}])
    assert rows[0].steps == 3
    with pytest.raises(UserError, match="status history, row 1: time"):
        parse_history([{"time": 1.0}, {"time": "noon"}])
    with pytest.raises(UserError, match="must be a list"):
        parse_history("rows")


@pytest.mark.parametrize("answer", [None, [], "hello", {"history": []}])
def test_foreign_answers_are_refused(answer: Any) -> None:
    with pytest.raises(UserError, match="no snapshot"):
        parse_reply(answer)


def test_overhead_is_busy_time_without_work() -> None:
    assert overhead({"simulate": 4.0, "infer": 5.0, "upload": 1.0, "wait": 90.0}) == pytest.approx(
        0.1
    )
    assert overhead({"update": 3.0, "publish": 0.5, "other": 0.5}) == pytest.approx(0.25)
    assert overhead({"update": 3.0, "wait": 1.0}) == 0.0
    assert overhead({"wait": 3.0}) is overhead({}) is None
    for activities in (ACTOR_ACTIVITIES, LEARNER_ACTIVITIES):
        assert WORK & set(activities) and {"wait", "other"} <= set(activities)


def test_shares_sum_to_one() -> None:
    assert shares_of({"simulate": 1.0, "wait": 3.0}) == {"simulate": 0.25, "wait": 0.75}
    assert shares_of({}) == shares_of({"wait": 0.0}) == {}


@pytest.mark.parametrize(
    ("waits", "idle", "word"),
    [
        (0.3, 0.0, "actor-bound"),
        (0.3, 0.9, "actor-bound"),
        (0.02, 0.8, "learner-bound"),
        (0.02, 0.3, "balanced"),
    ],
)
def test_balance_in_a_word(waits: float, idle: float, word: str) -> None:
    assert balance_word(waits, idle) == word
    assert word in VERDICTS
