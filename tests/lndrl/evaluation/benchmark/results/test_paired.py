"""Differences over the same episodes, against figures that others have published."""

from __future__ import annotations

import math

import pytest

from lndrl.evaluation.benchmark.results import Difference, paired_interval
from lndrl.wilson import wilson_interval
from tests.lndrl.evaluation.benchmark.results.rows import row


@pytest.mark.parametrize(
    ("table", "interval"),
    [
        # Fagerland, Lydersen and Laake (2014), airway hyper-responsiveness.
        ((1, 1, 7, 12), (-0.507, -0.026)),
        # Altman et al., Statistics with Confidence (2000), table 6.2.
        ((14, 5, 0, 22), (0.011, 0.226)),
    ],
)
def test_the_interval_is_newcombes(
    table: tuple[int, int, int, int], interval: tuple[float, float]
) -> None:
    assert paired_interval(*table) == pytest.approx(interval, abs=6e-4)


def test_who_is_first_changes_the_sign_alone() -> None:
    low, high = paired_interval(31, 4, 17, 8)
    assert paired_interval(31, 17, 4, 8) == pytest.approx((-high, -low))


def test_pairs_tell_more_than_as_many_strangers() -> None:
    low, high = paired_interval(400, 20, 40, 40)
    (low_1, high_1), (low_2, high_2) = wilson_interval(420, 500), wilson_interval(440, 500)
    unpaired = math.hypot(0.84 - low_1, high_2 - 0.88) + math.hypot(0.88 - low_2, high_1 - 0.84)
    assert high - low < 0.9 * unpaired
    # Where they are against each other, pairs tell less; no correction narrows that.
    low, high = paired_interval(200, 220, 240, 0)
    assert low < -20 / 660 < high


def test_nobody_differing_is_no_certainty() -> None:
    low, high = paired_interval(500, 0, 0, 0)
    assert low == pytest.approx(-high) and 0.001 < high < 0.02
    assert paired_interval(0, 0, 0, 0) == (-1.0, 1.0)
    assert paired_interval(0, 3, 0, 0)[1] == 1.0
    with pytest.raises(ValueError, match="cannot be negative"):
        paired_interval(3, -1, 0, 0)


@pytest.mark.parametrize(
    ("only_first", "only_second", "p"),
    # The binomial tails by hand: 2 (1 + 8) / 2^8, 2 (1 + 14 + 91) / 2^14, 2 / 2^5.
    [(1, 7, 18 / 256), (2, 12, 212 / 16384), (5, 0, 2 / 32), (3, 3, 1.0), (0, 0, 1.0)],
)
def test_p_is_mcnemars_exact_one(only_first: int, only_second: int, p: float) -> None:
    first = row("one", "a" * only_first + "c" * only_second + "aac")
    second = row("two", "c" * only_first + "a" * only_second + "aac")
    found = Difference.of(first, second, "arrived")
    assert found.p == pytest.approx(p)
    assert (found.both, found.only_first, found.only_second, found.neither) == (
        2, only_first, only_second, 1,
    )  # fmt: skip
    assert found.value == pytest.approx((only_first - only_second) / found.episodes)
    assert found.to_dict()["discordant"] == only_first + only_second


def test_only_episodes_that_both_have_driven_count() -> None:
    found = Difference.of(row("one", "alal"), row("two", "ll"), "lost")
    assert (found.both, found.only_first, found.only_second, found.neither) == (1, 0, 1, 0)
    assert Difference.of(row("one", "a"), row("two", "a", "hall"), "lost").episodes == 0
