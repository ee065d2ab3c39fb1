"""Drives, replays and figures of the localization report."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lndrl.config import LaserConfig, LocalizationConfig, TaskConfig, WorldConfig
from lndrl.errors import UserError
from lndrl.evaluation.localization.drives import DISPLACEMENT, Drive, record_drive
from lndrl.evaluation.localization.figures import (
    Outcome,
    cell_of,
    censored_median,
    errors,
    lost_ticks,
    mean_interval,
    recovery_seconds,
    rmse,
)
from lndrl.evaluation.localization.replay import TROUBLES, Replayer
from lndrl.evaluation.localization.report import Plan, measure_localization
from lndrl.evaluation.localization.settings import scenarios_named, with_pedestrians
from lndrl.evaluation.localization.tour import RouteMap, Tour
from lndrl.localization import LikelihoodMap
from lndrl.randomness import stream_state
from lndrl.scenario import Scenario
from lndrl.world import Place

ROOMS = Scenario.model_validate(
    {
        "name": "rooms",
        "size": [12.0, 9.0],
        # A wall with a door of 1.2 m, a pillar before it, and boxes so that corners differ.
        "obstacles": [
            {"box": [6.0, 0.1, 6.2, 4.0]},
            {"box": [6.0, 5.2, 6.2, 8.9]},
            {"circle": [4.4, 4.6, 0.3]},
            {"box": [1.0, 6.5, 2.0, 7.0]},
            {"box": [9.0, 1.0, 9.4, 2.6]},
        ],
        "pedestrians": {
            "count": [3, 3],
            "routes": [{"start": [1, 1, 2, 2], "goal": [4, 7, 5, 8]}],
        },
        "robot": [{"start": [1, 1, 3, 3], "goal": [8, 6, 10, 8]}],
    }
)
EXACT = WorldConfig.model_validate(
    {"odometry_deviation": 0.0, "laser": {"z_hit": 1.0, "z_max": 0.0, "z_rand": 0.0}}
)
FAST = {"min_particles": 200, "max_particles": 400}
PAPER = LocalizationConfig.model_validate(FAST)


def place_with(people: int, scenario: Scenario = ROOMS) -> Place:
    return Place.build(with_pedestrians(scenario, people))


@pytest.fixture(scope="module")
def empty() -> tuple[Place, RouteMap]:
    place = place_with(0)
    return place, RouteMap.build(place)


@pytest.fixture(scope="module")
def drive(empty: tuple[Place, RouteMap]) -> Drive:
    return record_drive(*empty, WorldConfig(), seed=1, updates=400)


def replayer(place: Place, config: LocalizationConfig = PAPER) -> Replayer:
    field = LikelihoodMap.build(place.grid, config)
    return Replayer(field, config, LaserConfig(), TaskConfig())


def test_routes_keep_to_free_floor_and_lead_through_the_door(
    empty: tuple[Place, RouteMap],
) -> None:
    place, routes = empty
    assert min(place.room(*node) for node in routes.nodes) >= place.robot_radius + 0.1
    start, goal = routes.nearest(np.array([1.5, 1.5])), routes.nearest(np.array([11.0, 1.0]))
    following = routes.toward(goal)
    way = [start]
    while way[-1] != goal:
        way.append(int(following[way[-1]]))
    steps = np.diff(routes.nodes[way], axis=0)
    assert np.hypot(*steps.T).max() < 0.3
    crossing = routes.nodes[way][np.abs(routes.nodes[way][:, 0] - 6.1) < 0.15]
    assert len(crossing) and (np.abs(crossing[:, 1] - 4.6) < 0.4).all()
    assert len(np.unique(routes.parts)) == 1


def test_parts_that_are_not_connected_are_told_apart() -> None:
    closed = ROOMS.model_copy(
        update={
            "obstacles": [*ROOMS.obstacles, ROOMS.obstacles[0].model_copy(
                update={"box": (6.0, 3.9, 6.2, 5.3)}
            )],
            "robot": [ROOMS.robot[0].model_copy(update={"goal": (1.0, 3.0, 3.0, 5.0)})],
        }
    )  # fmt: skip
    place = place_with(0, closed)
    routes = RouteMap.build(place)
    west, east = routes.nearest(np.array([1.5, 1.5])), routes.nearest(np.array([11.0, 1.0]))
    assert routes.parts[west] != routes.parts[east]
    assert routes.toward(east)[west] < 0
    drive = record_drive(place, routes, WorldConfig(), seed=2, updates=300)
    assert drive.truth[:, 0].max() < 6.0 and drive.goals_reached > 0


@pytest.mark.parametrize("seed", range(4))
def test_a_tour_reaches_goals_and_no_wall(empty: tuple[Place, RouteMap], seed: int) -> None:
    drive = record_drive(*empty, EXACT, seed, 600)
    place, _ = empty
    assert drive.goals_reached >= 2
    assert drive.hits == {"wall": 0, "pedestrian": 0}
    assert min(place.room(*pose[:2]) for pose in drive.truth) > place.robot_radius
    speed = np.hypot(*np.diff(drive.truth[:, :2], axis=0).T) / 0.1
    assert speed.max() <= 0.6 + 1e-9
    assert drive.length > 10.0
    turns = np.abs(np.diff(np.unwrap(drive.truth[:, 2]))) / 0.1
    assert turns.max() <= 0.9 + 1e-9


def test_a_tour_gives_way_to_people(empty: tuple[Place, RouteMap]) -> None:
    tour = Tour(*empty, 0.4, stream_state(5))
    pose, nobody = np.array([3.0, 2.0, 0.0]), np.zeros((0, 2))
    for _ in range(20):  # first it turns toward its goal
        free = tour.command(pose, nobody, nobody)
        if free[0] > 0.5:
            break
        pose[2] += 0.4 * free[1]
    ahead = pose[:2] + 0.8 * np.array([np.cos(pose[2]), np.sin(pose[2])])
    behind = 2.0 * pose[:2] - ahead
    standing = np.zeros((1, 2))
    assert tour.command(pose, behind[None], standing) == free
    v, w = tour.command(pose, ahead[None], standing)
    assert v < free[0] or abs(w - free[1]) > 0.3
    # One that comes from farther off is as near in a second.
    coming = pose[:2] + 2.0 * (ahead - pose[:2])
    assert tour.command(pose, coming[None], standing) == free
    assert tour.command(pose, coming[None], (pose[:2] - coming)[None]) != free


def test_contacts_are_counted_and_end_nothing() -> None:
    """Twenty people in two rooms run into a robot that cannot flee."""
    place = place_with(20)
    drives = [
        record_drive(place, RouteMap.build(place), WorldConfig(), seed, 400) for seed in range(3)
    ]
    assert all(len(drive.truth) == 400 for drive in drives)
    assert sum(drive.hits["pedestrian"] for drive in drives) > 0
    assert sum(drive.hits["wall"] for drive in drives) == 0


def test_a_drive_is_bit_equal_from_its_seed(empty: tuple[Place, RouteMap], drive: Drive) -> None:
    again = record_drive(*empty, WorldConfig(), 1, 400)
    for name in ("start", "truth", "odometry", "ranges", "displaced"):
        np.testing.assert_array_equal(getattr(again, name), getattr(drive, name))
    other = record_drive(*empty, WorldConfig(), 2, 400)
    assert not np.array_equal(other.truth, drive.truth)


def test_the_crowd_alone_changes_the_layout_of_a_drive_little(drive: Drive) -> None:
    place = place_with(3)
    crowded = record_drive(place, RouteMap.build(place), WorldConfig(), 1, 400)
    np.testing.assert_array_equal(crowded.start, drive.start)
    assert not np.array_equal(crowded.ranges, drive.ranges)


def test_the_displaced_pose_is_free_and_as_far_as_said(
    empty: tuple[Place, RouteMap], drive: Drive
) -> None:
    place, _ = empty
    at = drive.truth[drive.halfway][:2]
    assert np.hypot(*(drive.displaced - at)) == pytest.approx(DISPLACEMENT)
    assert place.room(*drive.displaced) >= place.robot_radius


def test_odometry_is_exact_without_slip_and_drifts_with_it(
    empty: tuple[Place, RouteMap], drive: Drive
) -> None:
    def drift(each: Drive) -> float:
        x, y, yaw = each.start
        c, s = np.cos(yaw), np.sin(yaw)
        reckoned = np.column_stack(
            [
                x + c * each.odometry[:, 0] - s * each.odometry[:, 1],
                y + s * each.odometry[:, 0] + c * each.odometry[:, 1],
                yaw + each.odometry[:, 2],
            ]
        )
        return float(errors(reckoned, each.truth)[0].max())

    assert drift(record_drive(*empty, EXACT, 1, 300)) < 1e-9
    assert drift(drive) > 0.05


def test_perfect_sensors_give_small_errors(empty: tuple[Place, RouteMap]) -> None:
    place, routes = empty
    drive = record_drive(place, routes, EXACT, 1, 400)
    outcome = replayer(place).outcome(drive, 1, "paper", "rooms", 0)
    assert outcome.position_rmse < 0.06 and outcome.yaw_rmse < 0.02
    assert not outcome.lost and outcome.lost_time == 0.0 and outcome.worst < 0.2
    assert 200 <= outcome.particles <= 401 and 100 < outcome.effective <= 401
    assert outcome.microseconds > 0.0


def test_replays_are_deterministic_and_independent_of_what_ran_before(
    empty: tuple[Place, RouteMap], drive: Drive
) -> None:
    place, routes = empty
    one, other = replayer(place), replayer(place)
    other.outcome(record_drive(place, routes, WorldConfig(), 2, 100), 2, "", "", 0)
    for kind in TROUBLES:
        np.testing.assert_array_equal(one.after(kind, drive, 1), other.after(kind, drive, 1))
    a, b = one.whole(drive, 1), other.whole(drive, 1)
    np.testing.assert_array_equal(a.estimated, b.estimated)
    assert not np.array_equal(one.whole(drive, 9).estimated, a.estimated)


def test_a_filter_hears_the_ticks_that_its_setting_names(
    empty: tuple[Place, RouteMap], drive: Drive
) -> None:
    place, _ = empty
    settings = LocalizationConfig(update_ticks=[2, 4])
    field = LikelihoodMap.build(place.grid, settings)
    replayer = Replayer(field, settings, WorldConfig().laser, TaskConfig())
    seconds = replayer.whole(drive, 0).seconds
    assert (seconds[1::2] > 0.0).all() and not seconds[::2].any()


def test_trouble_starts_three_metres_off(empty: tuple[Place, RouteMap], drive: Drive) -> None:
    filter = replayer(empty[0])
    for kind in ("told", "carried"):
        after = filter.after(kind, drive, 1)
        assert len(after) == len(drive.truth) - drive.halfway
        assert after[0] == pytest.approx(DISPLACEMENT, abs=0.6)
    assert filter.after("global", drive, 1)[0] > 0.1


def test_a_wide_cloud_recovers_from_a_wrong_pose(
    empty: tuple[Place, RouteMap], drive: Drive
) -> None:
    """A filter that starts with 1.5 m and 0.1 rad of doubt finds the room's only good fit."""
    config = {"min_particles": 2000, "max_particles": 2000, "initial_deviation_xy": 1.5,
              "laser_z_rand": 0.001, "odom_alpha1": 2.0, "odom_alpha3": 2.0}  # fmt: skip
    wide = replayer(empty[0], LocalizationConfig.model_validate(config))
    sure = replayer(empty[0], PAPER)
    assert recovery_seconds(wide.after("told", drive, 1), drive.tick) is not None
    assert recovery_seconds(sure.after("told", drive, 1), drive.tick) is None


def test_errors_of_known_poses() -> None:
    truth = np.array([[1.0, 2.0, 3.1], [0.0, 0.0, 0.0]])
    estimated = truth + np.array([[0.3, -0.4, 0.2], [0.0, 0.0, -0.1]])
    position, yaw = errors(estimated, truth)
    np.testing.assert_allclose(position, [0.5, 0.0])
    np.testing.assert_allclose(yaw, [0.2, 0.1])  # 3.3 rad is -2.98 rad: wrapped
    estimated[0, 2] -= 2.0 * np.pi
    np.testing.assert_allclose(errors(estimated, truth)[1], [0.2, 0.1])
    assert rmse(np.array([3.0, 4.0, 0.0, 0.0])) == pytest.approx(2.5)


def test_lost_is_either_distance_or_angle() -> None:
    position, yaw = np.array([0.1, 2.1, 0.1, 2.0]), np.array([0.1, 0.1, 0.9, 0.7])
    assert lost_ticks(position, yaw, 2.0, np.pi / 4).tolist() == [False, True, True, False]


@pytest.mark.parametrize(
    ("below", "expected"),
    [
        ([], None),
        ([(0, 100)], 0.1),  # right from the first tick
        ([(30, 100)], 3.1),
        ([(10, 29), (50, 100)], 5.1),  # 1.9 s is not yet 2 s
        ([(10, 30), (50, 100)], 1.1),
        ([(80, 100)], 8.1),  # the last two seconds
        ([(81, 100)], None),  # the drive ends before
    ],
)
def test_recovery_time(below: list[tuple[int, int]], expected: float | None) -> None:
    error = np.full(100, 3.0)
    for first, last in below:
        error[first:last] = 0.4
    found = recovery_seconds(error, 0.1)
    assert found == (None if expected is None else pytest.approx(expected))


def test_exactly_half_a_metre_is_not_below() -> None:
    assert recovery_seconds(np.full(50, 0.5), 0.1) is None


def test_censored_median() -> None:
    assert censored_median([]) is None
    assert censored_median([3.0, None, 1.0]) == 3.0
    assert censored_median([None, None, 1.0]) is None
    assert censored_median([None, 2.0]) is None
    assert censored_median([4.0, 2.0]) == 3.0


def test_bootstrap_interval_covers_the_mean() -> None:
    """95 of 100 intervals should cover; fewer than 85 has a chance below 1e-4."""
    generator = np.random.default_rng(0)
    covered = 0
    for _ in range(100):
        low, high = mean_interval(list(generator.normal(2.0, 0.5, 40)))
        covered += low <= 2.0 <= high
    assert 85 <= covered <= 100
    assert mean_interval([1.0, 1.0]) == (1.0, 1.0)


def outcome(position: float, lost: bool, told: float | None, seed: int) -> Outcome:
    series = np.zeros(1, np.float32)
    return Outcome("s", "rooms", 5, seed, position, 0.1 * position, 2.0 * position, lost,
                   0.5 * lost, 500.0, 400.0, 80.0, {"told": told}, series)  # fmt: skip


def test_a_cell_gathers_its_drives() -> None:
    cell = cell_of([outcome(0.1, False, 4.0, 0), outcome(0.3, False, None, 1),
                    outcome(2.0, True, 6.0, 2)])  # fmt: skip
    assert cell.position_rmse == pytest.approx(0.8) and cell.position_median == 0.3
    assert (cell.worst, cell.lost.count, cell.lost.episodes) == (4.0, 1, 3)
    assert cell.lost_time == pytest.approx(1 / 6)
    assert cell.recovered["told"].count == 2 and cell.seconds["told"] == 6.0
    assert cell.effective == 400.0


def test_settings_hear_the_same_drives_and_workers_change_nothing() -> None:
    plan = Plan((ROOMS,), (0, 2), {"one": PAPER, "same": PAPER}, seeds=2, updates=80)
    seen: list[Outcome] = []
    here = measure_localization(plan, 0, seen.append)
    assert len(here.outcomes) == len(seen) == 8 and len(here.drives) == 4
    assert [(o.pedestrians, o.seed, o.setting) for o in here.outcomes[:4]] == [
        (0, 0, "one"), (0, 0, "same"), (0, 1, "one"), (0, 1, "same")]  # fmt: skip
    for a, b in zip(here.outcomes[::2], here.outcomes[1::2], strict=True):
        np.testing.assert_array_equal(a.errors, b.errors)
    assert len({o.position_rmse for o in here.outcomes}) == 4
    there = measure_localization(plan, 2)
    for a, b in zip(here.outcomes, there.outcomes, strict=True):
        np.testing.assert_array_equal(a.errors, b.errors)
        assert a.recovery == b.recovery
    assert here.drives == there.drives
    assert [c.drives for c in here.cells()] == [2] * 4
    assert here.summary()[0].scenario == "all"


def test_impossible_plans_are_refused() -> None:
    good: dict[str, Any] = {"scenarios": (ROOMS,), "pedestrians": (0,), "settings": {"a": PAPER},
            "seeds": 1, "updates": 80}  # fmt: skip
    changes: list[tuple[dict[str, Any], str]] = [
        ({"seeds": 0}, "0 seeds"),
        ({"updates": 10}, "10 updates"),
        ({"scenarios": (ROOMS, ROOMS)}, "scenario rooms is named twice"),
        ({"settings": {}}, "no setting"),
    ]
    for change, sentence in changes:
        with pytest.raises(UserError, match=sentence):
            measure_localization(Plan(**(good | change)))


def test_a_place_where_nobody_walks_takes_no_pedestrians() -> None:
    bare = ROOMS.model_copy(
        update={"pedestrians": ROOMS.pedestrians.model_validate({"count": [0, 0]})}
    )
    assert with_pedestrians(bare, 0).pedestrians.count == (0, 0)
    with pytest.raises(UserError, match="rooms with 3 pedestrians"):
        with_pedestrians(bare, 3)


def test_all_names_every_scenario_once() -> None:
    names = [scenario.name for scenario in scenarios_named(["all", "hybrid"])]
    assert "hybrid" in names and len(set(names)) == len(names)
