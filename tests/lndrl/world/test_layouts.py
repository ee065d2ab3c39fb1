"""Random layouts: a pure function of seed and number, and always playable."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.config import WorldConfig, load_scenario
from lndrl.errors import UserError
from lndrl.randomness import stream_state
from lndrl.scenario import Scenario
from lndrl.world import Place, World, layouts
from lndrl.world.layouts import generate, layout_number, place_of


def scenario(**random: object) -> Scenario:
    plain = {"name": "r", "kind": "random", "size": [24, 14], "random": random}
    return Scenario.model_validate({**plain, "pedestrians": {"count": [4, 8]}})


def test_a_layout_follows_from_seed_and_number() -> None:
    assert generate(scenario(), 5) == generate(scenario(), 5)
    assert generate(scenario(), 5).obstacles != generate(scenario(), 6).obstacles
    assert generate(scenario(), 5).obstacles != generate(scenario(seed=2), 5).obstacles
    assert generate(scenario(layouts=3), 5) == generate(scenario(layouts=3), 2)


@pytest.mark.parametrize("index", range(6))
def test_every_layout_can_be_played(index) -> None:
    place = Place.build(load_scenario("random"), layout=index)
    assert place.scenario.kind == "geometry" and place.scenario.name == f"random-{index}"
    assert len(place.scenario.obstacles) >= 3
    # All floor that offers room for a person hangs together.
    sizes = np.bincount(place.regions.ravel())[1:]
    assert sizes.max() >= 0.97 * sizes.sum()
    state = stream_state(index)
    for _ in range(50):
        start, goal = place.draw_task(state)
        assert 11.0 <= np.hypot(goal[0] - start[0], goal[1] - start[1]) <= 13.0
    world = World(place, WorldConfig())
    moved = []
    for number in range(3):
        world.reset(1, 0, number)
        before = world.pedestrian_position.copy()
        world.begin_step(0.0, 0.0)
        assert not world.tick()
        for _ in range(60):
            world.tick()
        moved += list(np.hypot(*(world.pedestrian_position - before).T))
    assert np.median(moved) > 1.0


def test_the_mix_decides_what_the_ground_becomes() -> None:
    only_open = {"rooms": 0, "corridors": 0, "clutter": 0, "open": 1}
    assert all(o.circle for o in generate(scenario(mix=only_open), 0).obstacles)
    rooms = generate(scenario(mix={**only_open, "rooms": 9, "open": 0}), 0).obstacles
    assert len(rooms) > 12 and all(o.box for o in rooms)


def test_worlds_are_spread_over_the_layouts() -> None:
    many = [layout_number(scenario(layouts=10), 1, world) for world in range(300)]
    assert set(many) == set(range(10))
    assert many != [layout_number(scenario(layouts=10), 2, world) for world in range(300)]
    assert layout_number(load_scenario("hybrid"), 1, 7) == 0


def test_a_size_that_holds_no_task_is_refused(monkeypatch) -> None:
    monkeypatch.setattr(layouts, "_ATTEMPTS", 2)
    tight = scenario().model_copy(update={"start_goal_distance": (60.0, 70.0)})
    with pytest.raises(UserError, match=r"scenario r: no layout of 27\.8 m from corner to corner"):
        generate(tight, 0)
    tight = scenario().model_copy(update={"start_goal_distance": (27.7, 27.8)})
    with pytest.raises(UserError, match=r"scenario r: none of 2 attempts at layout 0 .* 27\.7 to"):
        generate(tight, 0)


def test_large_layouts_have_tasks_at_the_distance_too(monkeypatch) -> None:
    monkeypatch.setattr(layouts, "_ATTEMPTS", 1)  # that many fail before the floor is searched
    large = generate(scenario().model_copy(update={"size": (100.0, 100.0), "resolution": 0.25}), 0)
    assert large.start_goal_distance == (11.0, 13.0) and len(large.robot) >= 6
    for task in large.robot:
        middles = [np.add(box[:2], box[2:]) / 2 for box in (task.start, task.goal)]
        assert 10.0 <= np.hypot(*(middles[1] - middles[0])) <= 14.0


def test_a_mixture_s_layouts_are_spread_over_its_places_by_weight() -> None:
    parts = [
        {"scenario": load_scenario("hybrid"), "weight": 3.0},
        {"scenario": scenario(layouts=5), "weight": 1.0},
    ]
    mixed = Scenario.model_validate({"name": "m", "kind": "mixed", "mixed": {"places": parts}})
    names = [place_of(mixed, index)[0].name for index in range(1000)]
    # Binomial: 750 with a deviation of 14.
    assert abs(names.count("hybrid") - 750) < 60
    assert names == [place_of(mixed, index)[0].name for index in range(1000)]
    first = names.index("hybrid"), names.index("r")
    assert Place.build(mixed, layout=first[0]).scenario.name == "hybrid"
    assert Place.build(mixed, layout=first[1]).scenario.name == f"r-{first[1] % 5}"
    numbers = {layout_number(mixed, 1, world) for world in range(40)}
    assert len(numbers) > 30 and max(numbers) < 1000
