"""Goals at their borders, and what is said while rows are missing."""

from __future__ import annotations

import pytest

from lndrl.evaluation.benchmark import Row
from lndrl.evaluation.benchmark.results import GOALS, verdicts
from tests.lndrl.evaluation.benchmark.results.rows import row, share

ARRIVAL, COLLISION, LOST, SHARE, RATIO, ABOVE = range(len(GOALS))


def judged(goal: int, ours: str, **others: str) -> bool | None:
    """The verdict on ``goal`` for a row of outcomes beside others."""
    rows: dict[str, Row] = {name: row(name, outcomes) for name, outcomes in others.items()}
    return verdicts("lndrl", {**rows, "lndrl": row("lndrl", ours)})[goal].met


@pytest.mark.parametrize(
    ("goal", "met", "not_met"),
    [
        (ARRIVAL, share(1900), share(1899)),
        (COLLISION, share(0, collided=60), share(0, collided=61)),
    ],
)
def test_a_limit_is_met_at_its_border(goal: int, met: str, not_met: str) -> None:
    assert judged(goal, met) is True
    assert judged(goal, not_met) is False


def test_lost_is_held_against_careful_where_that_is_worse() -> None:
    assert judged(LOST, share(0, lost=10)) is True  # whatever careful is
    assert judged(LOST, share(0, lost=11)) is None
    for careful, ours, met in ((4, 10, True), (4, 11, False), (15, 15, True), (15, 16, False)):
        assert judged(LOST, share(0, lost=ours), careful=share(0, lost=careful)) is met


def test_lost_is_a_quarter_of_the_lowest() -> None:
    others = {"dwa": share(0, 60), "drl_laser": share(0, 48), "drl_laser_ped": share(0, 80)}
    assert judged(SHARE, share(0, 12), **others) is True
    assert judged(SHARE, share(0, 13), **others) is False
    del others["drl_laser_ped"]
    assert judged(SHARE, share(0, 12), **others) is None  # it may be lower
    assert judged(SHARE, share(0, 13), **others) is False  # it cannot help
    assert judged(SHARE, share(0, 0)) is None


def test_arrival_is_a_multiple_of_dwas() -> None:
    assert judged(RATIO, share(1400), dwa=share(1000)) is True
    assert judged(RATIO, share(1399), dwa=share(1000)) is False
    # 1.4 x 1355 / 2000 = 1897 / 2000, which floats miss.
    assert judged(RATIO, share(1897), dwa=share(1355)) is True
    assert judged(RATIO, share(1400)) is None


def test_arrival_is_clearly_above_the_higher_of_two() -> None:
    low, high = share(1000), share(1500)
    both = {"drl_laser": high, "drl_laser_ped": low}
    assert judged(ABOVE, share(1520), **both) is True
    assert judged(ABOVE, share(1501), **both) is False  # one pair may be chance
    assert judged(ABOVE, share(1400), **both) is False  # above the lower alone
    assert judged(ABOVE, share(1520), drl_laser=high) is None


def test_a_row_that_is_not_there_has_reached_nothing_yet() -> None:
    found = verdicts("lndrl", {"dwa": row("dwa", share(1000))})
    assert [(each.seen, each.met) for each in found] == [("", None)] * len(GOALS)
    assert {each.to_dict()["verdict"] for each in found} == {"not there yet"}


def test_what_was_seen_is_said_beside_what_is_missing() -> None:
    rows = {"lndrl": row("lndrl", share(1000, 13)), "dwa": row("dwa", share(0, 48))}
    seen = verdicts("lndrl", rows)[SHARE].seen
    assert seen == "0.0065; dwa 0.0240; no drl_laser yet; no drl_laser_ped yet"
