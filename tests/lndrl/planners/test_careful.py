from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.navigation import Observation, action_table
from lndrl.planners import CarefulConfig, CarefulPlanner, PredictivePlanner, planner_source
from tests.lndrl.planners.seen import PERIOD, Person, drive, seen, wall_ahead

ROWS = np.arange(1)
GENTLE = 0.3 + 1e-9


def fresh(config: RunConfig, parameters: CarefulConfig | None = None) -> CarefulPlanner:
    planner = CarefulPlanner(config, parameters)
    planner.reset(0, [0])
    return planner


def late(config: RunConfig, steps: int) -> RunConfig:
    """Where the pose that the robot hears is ``steps`` control steps old."""
    localization = config.localization.model_copy(update={"delay": steps})
    return config.model_copy(update={"localization": localization})


def test_an_open_way_is_driven_straight_and_fast(config: RunConfig) -> None:
    assert fresh(config).act(seen((6.0, 0.0)), ROWS)[0] == pytest.approx((0.6, 0.0))


@settings(max_examples=25, deadline=None)
@given(bearing=st.floats(-math.pi, math.pi), distance=st.floats(1.5, 12.0))
def test_where_it_is_free_it_comes_by_gentle_turns(
    config: RunConfig, bearing: float, distance: float
) -> None:
    goal = (distance * math.cos(bearing), distance * math.sin(bearing))
    poses, commands = drive(fresh(config), round(distance / 0.24) + 35, goal)
    there = np.hypot(poses[:, 0] - goal[0], poses[:, 1] - goal[1]) < 0.5
    assert there.any()
    before = commands[: int(there.argmax()) // 10]
    assert np.abs(before[:, 1]).max(initial=0.0) <= GENTLE


@settings(max_examples=25, deadline=None)
@given(distance=st.floats(0.25, 3.0), beyond=st.floats(0.5, 8.0), aside=st.floats(-4.0, 4.0))
def test_it_never_drives_into_a_wall_ahead(
    config: RunConfig, distance: float, beyond: float, aside: float
) -> None:
    poses, _ = drive(fresh(config), 30, (distance + beyond, aside), wall=distance)
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
    meets = ahead / 0.6 + late

    def walker(time: float) -> list[Person]:
        return [(ahead, side * speed * (meets - time), 0.0, -side * speed)]

    poses, _ = drive(fresh(config), 30, (9.0, 0.0), people=walker)
    for k, pose in enumerate(poses):
        x, y, _, _ = walker(k * PERIOD / 10)[0]
        assert math.hypot(pose[0] - x, pose[1] - y) > 0.17 + 0.2


def test_it_goes_around_what_the_other_stands_before(config: RunConfig) -> None:
    """A panel across the way, its nearer end too far for two actions."""
    goal, panel = (4.0, 0.0), (1.5, -1.6, 2.0)
    poses, _ = drive(fresh(config), 60, goal, panel=panel)
    assert np.hypot(poses[:, 0] - 4.0, poses[:, 1]).min() < 0.5
    poses, _ = drive(PredictivePlanner(config), 60, goal, panel=panel)
    assert np.hypot(poses[:, 0] - 4.0, poses[:, 1]).min() > 0.5


def test_turning_is_dear_where_the_filter_cannot_follow(config: RunConfig) -> None:
    """A settled cloud is left behind, a wide one follows, several clouds must not be mixed up."""
    planner = fresh(config)
    settled, wide, several = (
        planner.costs(seen((2.0, 2.0), variances=(each, each, 0.0)), ROWS)[0].reshape(4, 7)
        for each in (0.0, 0.01, 0.5)
    )
    gentle, sharp = [2, 3, 4], [0, 1, 5, 6]
    assert (settled[:, sharp] - wide[:, sharp]).min() > (settled - wide)[:, gentle].max() + 5.0
    assert (several[:, sharp] - wide[:, sharp]).min() > (several - wide)[:, gentle].max() + 5.0


def test_a_filter_without_variances_is_refused(config: RunConfig) -> None:
    perfect = config.localization.model_copy(update={"kind": "perfect"})
    with pytest.raises(UserError, match=r"^careful: localization perfect has no variances and"):
        CarefulPlanner(config.model_copy(update={"localization": perfect}))


def test_it_turns_round_gently(config: RunConfig) -> None:
    """Where nothing is in the way: ``predictive`` is as quick as it can."""
    behind = seen((-5.0, 1.0), variances=(1e-4, 1e-4, 1e-4))
    assert 0.0 < abs(fresh(config).act(behind, ROWS)[0, 1]) <= GENTLE
    assert abs(PredictivePlanner(config).act(behind, ROWS)[0, 1]) > GENTLE


@pytest.mark.parametrize("delay", [1, 3])
def test_a_goal_that_is_old_is_moved_on(config: RunConfig, delay: int) -> None:
    """By what it told the robot to do since: then it decides as one who hears at once."""
    there = np.array([2.0, 1.5])
    old, pose = fresh(late(config, delay)), np.zeros(3)
    now, poses = fresh(config), [pose]
    for _ in range(8):
        goals = []
        for known in (poses[max(len(poses) - 1 - delay, 0)], pose):
            cosine, sine = math.cos(known[2]), math.sin(known[2])
            goals.append(np.array([[cosine, sine], [-sine, cosine]]) @ (there - known[:2]))
        np.testing.assert_allclose(
            old.costs(seen(tuple(goals[0])), ROWS),
            now.costs(seen(tuple(goals[1])), ROWS),
            atol=1e-4,
        )
        (v, w), other = (
            p.act(seen(tuple(g)), ROWS)[0] for p, g in zip((old, now), goals, strict=True)
        )
        np.testing.assert_array_equal((v, w), other)
        for _ in range(1000):
            middle = pose[2] + 0.5e-3 * w * PERIOD
            pose = pose + 1e-3 * PERIOD * np.array([v * math.cos(middle), v * math.sin(middle), w])
        poses.append(pose)


def test_rows_remember_what_they_did_themselves(config: RunConfig) -> None:
    planner, alone = CarefulPlanner(late(config, 1)), fresh(late(config, 1))
    planner.reset(0, [4, 5])
    left, right = seen((0.0, 3.0)), seen((0.0, -3.0), wall_ahead(1.0))
    for _ in range(3):
        both = planner.act(Observation.concatenate([left, right]), np.arange(2))
        np.testing.assert_array_equal(both[1], alone.act(right, ROWS)[0])
    # The first has ended; the second goes on as if nothing had been.
    np.testing.assert_array_equal(planner.act(right, np.array([1])), alone.act(right, ROWS))
    planner.reset(0, [4, 5])
    np.testing.assert_array_equal(planner.act(right, np.array([1])), fresh(config).act(right, ROWS))


def test_costs_name_what_it_takes_and_change_nothing(config: RunConfig) -> None:
    planner, table = fresh(config), action_table(config.task)
    observation = seen((4.0, 2.0), wall_ahead(1.0), [(1.0, 1.0, -0.3, 0.0)])
    for _ in range(3):
        costs = planner.costs(observation, ROWS)
        np.testing.assert_array_equal(planner.costs(observation, ROWS), costs)
        np.testing.assert_array_equal(planner.act(observation, ROWS)[0], table[costs[0].argmin()])


def test_without_numbers_it_stands(config: RunConfig) -> None:
    assert fresh(config).act(seen((math.nan, 0.0)), ROWS)[0] == pytest.approx((0.0, 0.0))
    unknown = seen((4.0, 0.0), variances=(math.nan, math.inf, 0.0))
    assert np.isfinite(fresh(config).costs(unknown, ROWS)).all()


def test_it_is_found_by_name(config: RunConfig) -> None:
    planner = planner_source("careful", {"rate_weight": 3.0}).build(config)
    assert isinstance(planner, CarefulPlanner)
    assert planner.parameters == CarefulConfig(rate_weight=3.0)


def test_what_forgets_its_commands_goes_by_what_it_sees(config: RunConfig) -> None:
    """What it was told to do before changes nothing, however late the pose is heard."""
    around = seen((4.0, 3.0))
    costs = {}
    for hears in (True, False):
        planner = fresh(late(config, 2), CarefulConfig(hears_commands=hears))
        at_rest = planner.costs(around, ROWS)
        planner.told(np.array([[0.6, 0.9]]), ROWS)
        costs[hears] = np.abs(planner.costs(around, ROWS) - at_rest).max()
        planner.begin(ROWS)
        np.testing.assert_array_equal(planner.costs(around, ROWS), at_rest)
    assert costs[False] == 0.0 < costs[True]
