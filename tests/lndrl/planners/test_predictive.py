from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.navigation import action_table
from lndrl.planners import PredictiveConfig, PredictivePlanner, planner_source
from tests.lndrl.planners.seen import Person, drive, seen, wall_ahead

ROWS = np.arange(1)


def test_an_open_way_is_driven_straight_and_fast(config: RunConfig) -> None:
    planner = PredictivePlanner(config)
    assert planner.act(seen((6.0, 0.0)), ROWS)[0] == pytest.approx((0.6, 0.0))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_turns_to_a_goal_at_the_side_and_behind(config: RunConfig, side: float) -> None:
    planner = PredictivePlanner(config)
    for goal in ((2.0, 3.0 * side), (-4.0, 1.0 * side)):
        assert planner.act(seen(goal), ROWS)[0, 1] * side > 0.25


@settings(max_examples=25, deadline=None)
@given(bearing=st.floats(-math.pi, math.pi), distance=st.floats(0.8, 12.0))
def test_it_comes_wherever_it_is_free(config: RunConfig, bearing: float, distance: float) -> None:
    """Also near the goal: it neither stands before it nor circles it."""
    goal = (distance * math.cos(bearing), distance * math.sin(bearing))
    poses, _ = drive(PredictivePlanner(config), round(distance / 0.24) + 15, goal)
    assert np.hypot(poses[:, 0] - goal[0], poses[:, 1] - goal[1]).min() < 0.5


@settings(max_examples=25, deadline=None)
@given(distance=st.floats(0.25, 3.0), beyond=st.floats(0.5, 8.0), aside=st.floats(-4.0, 4.0))
def test_it_never_drives_into_a_wall_ahead(
    config: RunConfig, distance: float, beyond: float, aside: float
) -> None:
    poses, _ = drive(PredictivePlanner(config), 30, (distance + beyond, aside), wall=distance)
    assert poses[:, 0].max() < distance - 0.17


@settings(max_examples=25, deadline=None)
@given(
    ahead=st.floats(1.5, 3.0),
    speed=st.floats(0.2, 0.5),
    late=st.floats(-1.0, 1.0),
    side=st.sampled_from([1.0, -1.0]),
)
def test_it_keeps_away_from_a_walker_who_crosses(
    config: RunConfig, ahead: float, speed: float, late: float, side: float
) -> None:
    """Who would meet it, had it driven on, give or take a second."""
    meets = ahead / 0.6 + late

    def walker(time: float) -> list[Person]:
        return [(ahead, side * speed * (meets - time), 0.0, -side * speed)]

    poses, _ = drive(PredictivePlanner(config), 30, (9.0, 0.0), people=walker)
    for k, pose in enumerate(poses):
        x, y, _, _ = walker(k * 0.04)[0]
        assert math.hypot(pose[0] - x, pose[1] - y) > 0.17 + 0.2


def test_echoes_of_people_are_people_who_walk(config: RunConfig) -> None:
    """Legs ahead stand in the way as a wall would, and are gone by then as a walker's."""
    ranges = np.full(720, 12.0)
    ranges[355:366] = 0.9
    planner = PredictivePlanner(config)
    stands = planner.act(seen((6.0, 0.0), ranges, [(1.0, 0.0, 0.0, 0.0)]), ROWS)[0]
    leaves = planner.act(seen((6.0, 0.0), ranges, [(1.0, 0.0, 0.6, 0.0)]), ROWS)[0]
    assert stands != pytest.approx((0.6, 0.0))
    assert leaves == pytest.approx((0.6, 0.0))
    assert planner.act(seen((6.0, 0.0), ranges), ROWS)[0] != pytest.approx((0.6, 0.0))


def test_a_single_echo_is_none(config: RunConfig) -> None:
    """The laser makes up one reading in a hundred."""
    ranges = np.full(720, 12.0)
    ranges[360] = 0.4
    planner = PredictivePlanner(config)
    assert planner.act(seen((6.0, 0.0), ranges), ROWS)[0] == pytest.approx((0.6, 0.0))


def test_costs_name_what_it_takes(config: RunConfig) -> None:
    planner, table = PredictivePlanner(config), action_table(config.task)
    observation = seen((4.0, 2.0), wall_ahead(1.0), [(1.0, 1.0, -0.3, 0.0)])
    costs = planner.costs(observation, ROWS)
    assert costs.shape == (1, 28)
    assert np.isfinite(costs).all()
    np.testing.assert_array_equal(planner.act(observation, ROWS)[0], table[costs[0].argmin()])


def test_variances_and_older_scans_do_not_matter(config: RunConfig) -> None:
    planner, plain = PredictivePlanner(config), seen((3.0, 1.0), wall_ahead(1.2))
    unsure = seen((3.0, 1.0), wall_ahead(1.2), variances=(3.0, 3.0, 1.0))
    np.testing.assert_array_equal(planner.costs(plain, ROWS), planner.costs(unsure, ROWS))
    several = plain.take(ROWS)
    several.scan = np.concatenate([np.zeros((1, 1440), np.uint16), plain.scan], axis=1)
    np.testing.assert_array_equal(planner.costs(plain, ROWS), planner.costs(several, ROWS))


def test_without_a_goal_it_stands(config: RunConfig) -> None:
    planner = PredictivePlanner(config)
    for x in (math.nan, math.inf):
        assert planner.act(seen((x, 0.0)), ROWS)[0] == pytest.approx((0.0, 0.0))


def test_it_is_found_by_name_and_its_parameters_are_checked(config: RunConfig) -> None:
    planner = planner_source("predictive").build(config)
    assert isinstance(planner, PredictivePlanner)
    assert planner.parameters == PredictiveConfig()
    planner = planner_source("predictive", {"goal_weight": 2.0}).build(config)
    assert isinstance(planner, PredictivePlanner) and planner.parameters.goal_weight == 2.0
    with pytest.raises(UserError, match="did you mean goal_weight"):
        planner_source("predictive", {"goal_wieght": 2.0})
    with pytest.raises(UserError, match="predictive: sample_period = 0: "):
        planner_source("predictive", {"sample_period": 0})
    with pytest.raises(UserError, match=r"detour_blocked 0\.25 must not exceed detour_close"):
        planner_source("predictive", {"detour_close": 0.1})
