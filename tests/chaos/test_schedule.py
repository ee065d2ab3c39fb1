"""Faults repeat by seed, end in time and leave each other's lanes alone."""

from __future__ import annotations

from collections import Counter, defaultdict
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lndrl.chaos.schedule import GUARD, KINDS, LEARNER, schedule


def test_a_seed_is_one_schedule() -> None:
    first = schedule(1, 60.0)
    assert first == schedule(1, 60.0)
    assert first != schedule(2, 60.0)


def test_an_hour_holds_more_than_200_faults_of_every_kind() -> None:
    faults = schedule(1, 60.0)
    counts = Counter(fault.kind for fault in faults)
    assert len(faults) >= 200
    assert set(counts) == set(KINDS)
    assert counts["learner_kill"] >= 8


@given(st.integers(0, 10**6), st.floats(0.1, 20.0), st.integers(1, 5), st.floats(2.0, 30.0))
def test_faults_end_in_time_and_do_not_overlap_on_their_lane(
    seed: int, minutes: float, actors: int, pace: float
) -> None:
    lanes = defaultdict(list)
    faults = schedule(seed, minutes, actors, pace)
    assert faults == sorted(faults, key=lambda fault: fault.time)
    for fault in faults:
        kind = KINDS[fault.kind]
        low, high = kind.durations
        assert low <= fault.duration <= high
        assert minutes >= kind.least
        assert fault.time + fault.duration <= 60.0 * minutes + 0.01
        lanes[fault.target].append(fault)
    for target, own in lanes.items():
        guard = GUARD if target == LEARNER else 0.0
        for before, after in pairwise(own):
            assert after.time >= before.time + before.duration + guard - 0.02


def test_kinds_can_be_chosen_and_unknown_ones_are_named() -> None:
    assert {f.kind for f in schedule(3, 10.0, kinds=["actor_kill"])} == {"actor_kill"}
    assert schedule(3, 10.0, kinds=[]) == []
    with pytest.raises(ValueError, match="earthquake"):
        schedule(3, 10.0, kinds=["earthquake"])
