from typing import Any

import numpy as np
import pytest

from lndrl.errors import UserError
from lndrl.randomness import stream_state
from lndrl.scenario import Scenario
from lndrl.world import Place

GOOD: dict[str, Any] = {
    "name": "small",
    "size": [10.0, 6.0],
    "obstacles": [{"box": [4.0, 1.0, 5.0, 4.0]}, {"circle": [8.0, 4.5, 0.4]}],
    "pedestrians": {
        "count": [2, 3],
        "routes": [{"start": [1, 1, 2, 2], "goal": [6, 1, 7, 2], "via": [[4.5, 5.0]]}],
    },
    "robot": [{"start": [1, 1, 2, 2], "goal": [7, 1, 9, 3]}],
    "start_goal_distance": [5.5, 7.0],
}


def changed(**changes):
    return Scenario.model_validate({**GOOD, **changes})


def people(**route):
    return {"count": [1, 1], "routes": [{**GOOD["pedestrians"]["routes"][0], **route}]}


def test_build_rasterises_once_and_keeps_the_scenario():
    place = Place.build(changed())
    assert place.grid.shape == (120, 200) == place.distance.shape
    assert place.distance.dtype == np.float32
    assert place.walls.shape == (4 + 4 + 15, 4)
    assert place.room(2.0, 3.0) == pytest.approx(1.9, abs=0.05)
    assert place.room(4.5, 2.0) == 0.0
    assert place.room(-1.0, 2.0) == 0.0


def test_tasks_are_free_connected_and_at_the_distance():
    place = Place.build(changed())
    state = stream_state(1)
    swapped = 0
    for _ in range(300):
        start, goal = place.draw_task(state)
        assert 5.5 <= np.hypot(goal[0] - start[0], goal[1] - start[1]) <= 7.0
        assert min(place.room(*start), place.room(*goal)) >= 0.27
        swapped += start[0] > goal[0]
    assert 100 < swapped < 200  # both_ways: half of them


def test_one_way_tasks_keep_their_direction_and_weights_count():
    tasks = [
        {"start": [1, 1, 2, 2], "goal": [7, 1, 9, 3], "both_ways": False, "weight": 3.0},
        {"start": [8, 1, 9, 2], "goal": [1, 4, 3, 5], "both_ways": False, "weight": 1.0},
    ]
    place = Place.build(changed(robot=tasks))
    state = stream_state(2)
    first = sum(place.draw_task(state)[0][0] < 5 for _ in range(800))
    assert first / 800 == pytest.approx(0.75, abs=0.06)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"robot": [{"start": [1, 1, 2, 2], "goal": [7, 1, 11, 3]}]},
            r"scenario small: robot\.0\.goal .* leaves the map; it must lie in \[0, 0, 10, 6\]",
        ),
        (
            {"robot": [{"start": [4.1, 1.2, 4.9, 3.8], "goal": [7, 1, 9, 3]}]},
            r"scenario small: robot\.0\.start .* has no point with 0\.27 m of free room; move",
        ),
        (
            {"robot": [{"start": [2, 1, 1, 2], "goal": [7, 1, 9, 3]}]},
            r"scenario small: robot\.0\.start .* must be \[x_min, y_min, x_max, y_max\]",
        ),
        (
            {"start_goal_distance": [20, 30]},
            r"scenario small: robot\.0 has no connected start and goal that are 20 to 30 m apart",
        ),
        (
            {"obstacles": [{"box": [4, 0, 5, 6]}]},
            r"scenario small: robot\.0 has no connected start and goal",
        ),
        (
            {"pedestrians": people(start=[4.1, 1.2, 4.9, 3.8])},
            r"scenario small: pedestrians\.routes\.0\.start .* has no point",
        ),
        (
            {"pedestrians": people(goal=[-1, 1, 2, 2])},
            r"scenario small: pedestrians\.routes\.0\.goal .* leaves the map",
        ),
        (
            {"pedestrians": people(via=[[4.5, 2.0]])},
            r"scenario small: pedestrians\.routes\.0\.via \[4\.5, 2\] lies in a wall",
        ),
    ],
)
def test_bad_scenarios_are_refused_with_a_sentence(changes, sentence):
    with pytest.raises(UserError, match=sentence):
        Place.build(changed(**changes))


def test_a_larger_robot_needs_more_room():
    robot = [{"start": [1, 1, 2, 2], "goal": [5.2, 1.0, 5.8, 2.0]}]
    narrow = {**GOOD, "robot": robot, "start_goal_distance": [3, 5]}
    narrow["obstacles"] = [{"box": [4, 1, 5, 4]}, {"box": [6.0, 0.1, 6.5, 4]}]
    Place.build(Scenario.model_validate(narrow), 0.17)
    with pytest.raises(UserError, match=r"robot\.0\.goal"):
        Place.build(Scenario.model_validate(narrow), 0.6)
