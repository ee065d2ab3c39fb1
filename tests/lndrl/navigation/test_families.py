"""Worlds of training, validation, calibration and the bench never meet."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.config import MOST_WORLDS_PER_ACTOR
from lndrl.errors import UserError
from lndrl.evaluation.localization.drives import DRIVE_WORLD
from lndrl.navigation.families import WORLDS_PER_ACTOR, Family, episode_of, first_world_of_actor
from lndrl.randomness import episode_states

FAMILIES = st.sampled_from(Family)


def worlds(family: Family) -> range:
    return range(family.first, family.first + family.room)


def test_no_two_families_have_a_world_in_common() -> None:
    for one, other in combinations(Family, 2):
        assert max(one.first, other.first) >= min(worlds(one).stop, worlds(other).stop)
    assert not any(DRIVE_WORLD in worlds(family) for family in Family)


@given(index=st.integers(0, 2**63))
def test_no_actor_has_a_world_of_a_family(index: int) -> None:
    last = first_world_of_actor(index) + MOST_WORLDS_PER_ACTOR - 1
    assert 0 <= last < min(family.first for family in Family)


def test_actors_share_no_world_until_there_are_tens_of_thousands() -> None:
    assert MOST_WORLDS_PER_ACTOR <= WORLDS_PER_ACTOR
    firsts = [first_world_of_actor(index) for index in range(40_000)]
    assert firsts == list(range(0, 4_000_000_000, WORLDS_PER_ACTOR))


@settings(max_examples=200, deadline=None)
@given(data=st.data(), seed=st.integers(0, 2**63 - 1))
def test_whatever_the_seed_they_draw_other_numbers(data: st.DataObject, seed: int) -> None:
    """World ids beyond 32 bits are two words of the seed: they must not read as another's."""
    ids = {
        family: family.world(data.draw(st.integers(0, family.room - 1), family.value))
        for family in Family
    }
    episode = data.draw(st.integers(0, 2**32), "an actor's episode")
    # An actor's world with the same lower word as a test world, in any episode.
    low = {world % 2**32 for world in ids.values() if world % 2**32 < min(ids.values())}
    states = [episode_states(seed, world, 0) for world in ids.values()]
    states += [episode_states(seed, world, episode) for world in low]
    for one, other in combinations(states, 2):
        assert not np.array_equal(one, other)


@given(family=FAMILIES, data=st.data())
def test_an_episode_and_its_world_name_each_other(family: Family, data: st.DataObject) -> None:
    k = data.draw(st.integers(0, family.room - 1))
    assert family.episode(family.world(k)) == episode_of(family.world(k)) == k


def test_version_1_of_the_bench_was_tested_from_four_billion_on() -> None:
    assert Family.BENCH.world(7) == 4_000_000_007


@pytest.mark.parametrize("family", Family)
def test_what_a_family_has_not_is_refused(family: Family) -> None:
    for k in (-1, family.room):
        with pytest.raises(UserError, match=rf"episode {k} is none of {family.value}: it has 0 to"):
            family.world(k)
    for world in (family.first - 1, family.first + family.room, 0):
        with pytest.raises(ValueError, match=f"world {world} is none of {family.value}"):
            family.episode(world)
    with pytest.raises(ValueError, match=f"world {DRIVE_WORLD} is of no family"):
        episode_of(DRIVE_WORLD)
