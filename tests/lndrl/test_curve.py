"""When a validated curve has stopped rising; its rows are read in tests/learner/run."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lndrl.config import RunConfig, load_config
from lndrl.curve import conditions, score, standstill
from lndrl.errors import UserError

PATIENCE = 3000


def row(version: int, arrived: int, under: str = "x") -> dict[str, Any]:
    """A version of every thousandth step, of which 100 episodes were sampled."""
    sampled = {"arrived": arrived, "episodes": 100}
    return {"version": version, "steps": 1000 * version, "under": under, "sampled": sampled}


def config(*settings: str, patience: int = PATIENCE) -> RunConfig:
    return load_config("reward_alone", [f"learner.patience={patience}", *settings])


def ended(arrived: list[int], *settings: str, **options: int) -> tuple[int, int, int] | None:
    """Steps of the best version, from which they count, and at which it was enough."""
    curve = [row(version, each) for version, each in enumerate(arrived, 1)]
    found = standstill(curve, config(*settings, **options), "x")
    return None if found is None else (found.best, found.since, found.until)


def test_it_ends_where_the_best_is_as_old_as_patience() -> None:
    assert ended([50, 70, 50, 50]) is None, "2,000 steps after the best"
    assert ended([50, 70, 50, 50, 50]) == (2000, 2000, 5000)
    assert ended([50, 70, 50, 50, 50], patience=3001) is None
    assert ended([50, 70, 50, 50, 50], patience=0) is None


def test_what_rises_is_the_share_of_two_neighbours_and_a_tie_is_no_rise() -> None:
    assert score(row(2, 70), row(1, 50)) == 0.6 and score(row(1, 50), None) == 0.5
    # 60, 65, 60, 65: as good as the best is no better
    assert ended([60, 70, 50, 80, 50]) == (2000, 2000, 5000)
    # 60, 65, 60, 65.5
    assert ended([60, 70, 50, 81, 50]) is None


def test_imitation_is_never_ended_and_steps_count_from_its_end() -> None:
    falls = [80, 70, 60, 50, 50, 50, 50, 50, 50]
    taught = ("ppo.teacher=careful", "imitation.drive_steps=0", "imitation.steps=5500")
    assert ended(falls[:8], *taught) is None
    assert ended(falls, *taught) == (1000, 5500, 9000)
    assert ended(falls, *taught[1:]) == (1000, 1000, 4000), (
        "without a teacher there is no imitation"
    )


def test_without_an_evaluator_nothing_is_concluded() -> None:
    curve = [row(1, 50), row(2, 70)]
    assert standstill(curve, config(), "x") is None
    assert standstill([*curve, row(200, 90)], config(), "x") is None, "late, but it has risen"
    assert standstill([], config(), "x") is None


def test_other_episodes_are_no_measure_and_the_order_of_results_none() -> None:
    others = [row(version, 99, "y") for version in range(1, 9)]
    curve = [row(version, each) for version, each in enumerate([50, 70, 50, 50, 50], 1)]
    assert standstill(others, config(), "x") is None
    assert standstill(others[:1] + curve[::-1], config(), "x") == standstill(curve, config(), "x")
    assert conditions(config()) == conditions(config(patience=9))
    assert conditions(config()) != conditions(config("learner.validation_episodes=9"))


@given(st.lists(st.integers(0, 100), max_size=12), st.lists(st.integers(0, 100), max_size=4))
def test_more_rows_never_undo_it(arrived: list[int], more: list[int]) -> None:
    found = ended(arrived)
    assert found is None or ended([*arrived, *more]) == found


def test_it_says_what_was_waited_for() -> None:
    curve = [row(version, each) for version, each in enumerate([50, 70, 50, 50, 50], 1)]
    assert str(standstill(curve, config(), "x")) == (
        "validated arrivals have not risen from step 2,000 to 5,000, the most are 0.600 at step "
        "2,000 (learner.patience 3,000)"
    )


def test_patience_needs_something_to_wait_for() -> None:
    with pytest.raises(UserError, match=r"learner: patience .* needs validation_episodes above 0"):
        config("learner.validation_episodes=0")
    assert load_config("lndrl").learner.patience == 0, "off unless it is asked for"
