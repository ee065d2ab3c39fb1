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


def test_no_episode_starts_where_it_has_arrived():
    overlapping = [{"start": [1, 1, 3, 3], "goal": [1, 2, 3, 4]}]
    scenario = changed(robot=overlapping, start_goal_distance=None)
    nearest = {}
    for arrive in (None, 0.05, 1.2):
        place = Place.build(scenario, arrive_distance=arrive)
        state = stream_state(4)
        tasks = [place.draw_task(state) for _ in range(200)]
        nearest[arrive] = min(np.hypot(*np.subtract(goal, start)) for start, goal in tasks)
    assert 0.05 <= nearest[0.05] < 0.3  # so near they get where that is not there yet
    assert 0.5 <= nearest[None] < 0.7  # the configuration's default
    assert 1.2 <= nearest[1.2] < 1.5
    # The rule holds beside a distance that a scenario names.
    place = Place.build(changed(robot=overlapping, start_goal_distance=[0.0, 0.7]))
    state = stream_state(4)
    for _ in range(100):
        start, goal = place.draw_task(state)
        assert 0.5 <= np.hypot(*np.subtract(goal, start)) <= 0.7


def test_pairs_that_are_far_enough_are_drawn_as_ever():
    place, lenient = (Place.build(changed(), arrive_distance=a) for a in (0.5, 0.001))
    states = stream_state(6), stream_state(6)
    for _ in range(50):
        assert place.draw_task(states[0]) == lenient.draw_task(states[1])
    assert states[0].tolist() == states[1].tolist()


def test_regions_in_which_one_has_always_arrived_are_refused():
    same = [{"start": [1, 1, 1.2, 1.2], "goal": [1, 1, 1.2, 1.2]}]
    said = r"robot\.0 has no connected start and goal that are at least 0\.5 m"
    with pytest.raises(UserError, match=said + r" apart; nearer ones have arrived \(task\.arrive_"):
        Place.build(changed(robot=same, start_goal_distance=None))
    with pytest.raises(
        UserError, match=said + r" and at most 0\.4 m apart; .* or widen start_goal"
    ):
        Place.build(changed(robot=same, start_goal_distance=[0.1, 0.4]))
    with pytest.raises(UserError, match=r"that are at least 8 m and at most 7 m apart"):
        Place.build(changed(), arrive_distance=8.0)
