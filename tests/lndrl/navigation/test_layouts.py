"""Worlds of a random scenario: each in a layout of its own, and on to another in time."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.config import RunConfig, load_scenario
from lndrl.navigation import Navigation, VectorNavigation, build_surroundings
from lndrl.navigation.navigation import layout_of
from lndrl.scenario import Scenario

CONFIG = RunConfig.model_validate(
    {
        "seed": 3,
        "scenario": load_scenario("random").model_dump(),
        "localization": {"min_particles": 50, "max_particles": 100},
    }
)


STAY = 50
"""Episodes that a world spends in a layout unless told otherwise."""


@pytest.fixture(scope="module")
def vector() -> VectorNavigation:
    return VectorNavigation(CONFIG, first_world=5, worlds=2)


def test_worlds_live_in_different_layouts_and_step_together(vector: VectorNavigation) -> None:
    first, second = vector.worlds
    assert layout_of(CONFIG, 5, 0) != layout_of(CONFIG, 6, 0)
    assert first.place is not second.place
    assert first.place.cells.tobytes() != second.place.cells.tobytes()
    before = vector.observation.copy()
    result = vector.step(np.array([10, 17]))
    assert result.reward.shape == (2,) and (result.reward != 0).all()
    for i in range(2):
        assert (vector.observation.scan[i] != before.scan[i]).any()
        assert vector.worlds[i].observation.scan.tobytes() == vector.observation.scan[i].tobytes()


def test_a_world_moves_on_and_replays(vector: VectorNavigation) -> None:
    world = vector.worlds[0]
    home = world.place
    world.reset(STAY - 1)
    assert world.place is home
    world.reset(STAY)
    assert world.place.cells.tobytes() != home.cells.tobytes()
    world.step(0.2, 0.3)
    alone = Navigation(*build_surroundings(CONFIG), CONFIG, 5)
    alone.reset(STAY)
    alone.step(0.2, 0.3)
    assert alone.observation.scan.tobytes() == world.observation.scan.tobytes()
    assert (alone.localization.pose_estimated == world.localization.pose_estimated).all()


def test_other_scenarios_have_one_layout() -> None:
    plain = CONFIG.model_copy(update={"scenario": load_scenario("hall")})
    assert layout_of(plain, 7, 1000) == 0


def test_how_long_a_world_stays_is_a_key() -> None:
    def brief(episodes: int) -> RunConfig:
        keys = {"name": "r", "kind": "random", "size": [20, 20], "random": {"episodes": episodes}}
        return RunConfig.model_validate({"seed": 3, "scenario": keys})

    seen = [layout_of(brief(2), 5, episode) for episode in range(6)]
    assert seen[::2] == seen[1::2] and len(set(seen)) == 3
    assert len({layout_of(brief(6), 5, episode) for episode in range(6)}) == 1


def test_worlds_of_a_mixture_move_from_place_to_place() -> None:
    places = [{"scenario": load_scenario(name).model_dump()} for name in ("hall", "sparse")]
    mixed = {"name": "m", "kind": "mixed", "mixed": {"places": places, "episodes": 1}}
    config = CONFIG.model_copy(update={"scenario": Scenario.model_validate(mixed)})
    vector = VectorNavigation(config, first_world=0, worlds=2)
    world = vector.worlds[0]
    seen = []
    for episode in range(8):
        world.reset(episode)
        seen.append(world.place.scenario.name)
        assert not vector.step(np.array([10, 17])).terminated.any()
    assert set(seen) == {"hall", "sparse"}
