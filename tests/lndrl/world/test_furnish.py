"""People and tasks that are found on maps."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lndrl.config import WorldConfig, load_scenario
from lndrl.errors import UserError
from lndrl.maps.embedded import pack
from lndrl.maps.grid import distance_field
from lndrl.maps.ros_map import FREE, OCCUPIED, grid_of_cells
from lndrl.randomness import stream_state
from lndrl.scenario import Scenario
from lndrl.world import Place, World
from lndrl.world.furnish import find_tasks

STEP = 0.05
ORIGIN = (-12.3, 4.7)


def write_map(folder: Path, floor: np.ndarray, yaw: float = 0.0) -> Path:
    """``floor`` (rows, columns), row 0 at the bottom, as a PGM with its YAML file."""
    Image.fromarray(np.where(floor[::-1], 254, 0).astype(np.uint8)).save(folder / "b.pgm")
    (folder / "b.yaml").write_text(
        f"image: b.pgm\nresolution: {STEP}\norigin: [{ORIGIN[0]}, {ORIGIN[1]}, {yaw}]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return folder / "b.yaml"


def building(width: float = 30.0, height: float = 20.0) -> np.ndarray:
    """Rooms on both sides of a corridor, with doors of 1.2 m."""
    rows, columns = round(height / STEP), round(width / STEP)
    floor = np.zeros((rows, columns), bool)
    floor[4:-4, 4:-4] = True
    for low in (0.4, 0.6):
        wall = round(low * rows)
        floor[wall : wall + 4] = False
        for middle in range(columns // 8, columns, columns // 4):
            floor[wall : wall + 4, middle - 12 : middle + 12] = True
    for x in range(columns // 4, columns - 8, columns // 4):
        floor[: round(0.4 * rows), x : x + 4] = False
        floor[round(0.6 * rows) :, x : x + 4] = False
    return floor


def scenario(path: Path, **changes: object) -> Scenario:
    plain = {"name": "b", "kind": "map", "map": str(path), "pedestrians": {"count": [6, 9]}}
    return Scenario.model_validate({**plain, **changes})


def closed(rows: int, columns: int, wall: int = 4) -> np.ndarray:
    """An empty hall of that many cells, walls included."""
    floor = np.zeros((rows, columns), bool)
    floor[wall:-wall, wall:-wall] = True
    return floor


def built(floor: np.ndarray, **changes: object) -> Place:
    """The place of a map whose cells are ``floor`` or wall."""
    grid = grid_of_cells(np.where(floor, FREE, OCCUPIED).astype(np.uint8), STEP, ORIGIN)
    plain = {"name": "b", "kind": "map", "resolution": STEP, "size": grid.size}
    return Place.build(Scenario.model_validate({**plain, "cells": pack(grid), **changes}))


def room_between(place: Place, a: np.ndarray, b: np.ndarray) -> float:
    steps = int(np.hypot(*(b - a)) / 0.05) + 2
    return min(place.room(*(a + (b - a) * u)) for u in np.linspace(0, 1, steps))


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Place:
    return Place.build(scenario(write_map(tmp_path_factory.mktemp("map"), building())))


def test_a_map_of_30_by_20_m_is_furnished(place) -> None:
    assert place.grid.size == pytest.approx((30.0, 20.0)) == place.scenario.size
    assert place.map_origin == pytest.approx(ORIGIN) and place.grid.origin == (0.0, 0.0)
    assert place.notes == ()
    assert len(place.scenario.robot) >= 6
    assert len(place.scenario.pedestrians.routes) >= 10
    assert place.walls.shape[0] == sum(len(o) for o in place.outlines)
    regions = np.array([[*r.start, *r.goal] for r in place.scenario.pedestrians.routes])
    assert np.ptp(regions[:, [0, 4]]) > 20 and np.ptp(regions[:, [1, 5]]) > 12


def test_tasks_are_11_to_13_m_apart_and_reachable(place) -> None:
    state = stream_state(3)
    for _ in range(200):
        start, goal = place.draw_task(state)
        assert 11.0 <= np.hypot(goal[0] - start[0], goal[1] - start[1]) <= 13.0
        assert min(place.room(*start), place.room(*goal)) >= 0.26


def test_routes_do_not_cross_walls(place) -> None:
    for route in place.scenario.pedestrians.routes:
        for _ in range(3):
            rng = np.random.default_rng(0)
            ends = [rng.uniform(b[:2], b[2:]) for b in (route.start, route.goal)]
            path = [ends[0], *map(np.array, route.via), ends[1]]
            for a, b in pairwise(path):
                assert room_between(place, a, b) > 0.2


def test_people_walk_and_robots_start_free(place) -> None:
    world = World(place, WorldConfig())
    walking = []
    for number in range(4):
        world.reset(2, 0, number)
        before = world.pedestrian_position.copy()
        world.begin_step(0.0, 0.0)
        assert not world.tick()
        for _ in range(100):
            world.tick()
            assert min(place.room(*p) for p in world.pedestrian_position) > 0.1
        walking += list(np.hypot(*(world.pedestrian_position - before).T))
    assert np.median(walking) > 2.0  # of 5 m at full speed
    assert np.mean(np.array(walking) > 0.5) > 0.8


def test_the_same_map_gives_the_same_place(place, tmp_path) -> None:
    again = Place.build(scenario(write_map(tmp_path, building())))
    assert again.scenario.robot == place.scenario.robot
    assert again.scenario.pedestrians == place.scenario.pedestrians


def test_own_regions_are_given_in_the_frame_of_the_map(place, tmp_path) -> None:
    path = write_map(tmp_path, building())
    x, y = ORIGIN
    start, goal = (x + 8.5, y + 9.0, x + 9.5, y + 10.5), (x + 20.5, y + 9.0, x + 21.5, y + 10.5)
    rooms = {"start": (x + 1, y + 1, x + 2, y + 2), "goal": (x + 28, y + 17, x + 29, y + 19)}
    own = Place.build(
        scenario(
            path,
            robot=[{"start": start, "goal": goal}],
            pedestrians={"count": [2, 2], "routes": [rooms]},
        )
    )
    assert own.scenario.robot[0].start == pytest.approx((8.5, 9.0, 9.5, 10.5))
    (route,) = own.scenario.pedestrians.routes
    assert route.start == pytest.approx((1, 1, 2, 2))
    assert len(route.via) >= 2  # led around the walls
    with pytest.raises(
        UserError, match=r"robot\.0\.start \[-112\.3, .* must lie in \[-12\.3, 4\.7"
    ):
        far = (x - 100, y, x - 99, y + 1)
        Place.build(scenario(path, robot=[{"start": far, "goal": goal}]))


@pytest.mark.parametrize("yaw", [0.5, -2.0])
def test_a_turned_map_offers_as_much(place, tmp_path, yaw) -> None:
    turned = Place.build(scenario(write_map(tmp_path, building(), yaw)))
    assert turned.grid.free.sum() == pytest.approx(place.grid.free.sum(), rel=0.02)
    assert len(turned.scenario.robot) >= 6
    c, s = np.cos(yaw), np.sin(yaw)
    agree = []
    for x, y in np.random.default_rng(0).uniform((0.5, 0.5), (29.5, 19.5), (200, 2)):
        there = np.array([c * x - s * y, s * x + c * y]) + ORIGIN - turned.map_origin
        agree.append(abs(turned.room(*there) - place.room(x, y)) < 1.5 * STEP)
    assert np.mean(agree) > 0.98


def test_small_maps_shrink_what_is_asked_and_say_so(tmp_path) -> None:
    small = Place.build(scenario(write_map(tmp_path, building(9.0, 6.0)), pedestrians={}))
    nearest, farthest = small.scenario.start_goal_distance or (0, 0)
    assert 2.0 < nearest < farthest < 10.0
    assert small.scenario.pedestrians.count[1] < 12
    assert len(small.notes) == 2
    assert "the map offers no 11 m" in small.notes[1]


def distances(place: Place, tasks: int = 30) -> list[float]:
    """Start-goal distances (m) of drawn tasks."""
    state = stream_state(5)
    ends = [place.draw_task(state) for _ in range(tasks)]
    return [float(np.hypot(goal[0] - start[0], goal[1] - start[1])) for start, goal in ends]


@pytest.mark.parametrize("side", [40, 45, 60])
def test_large_empty_halls_get_tasks(side) -> None:
    hall = built(closed(20 * side, 20 * side))
    assert hall.scenario.start_goal_distance == (11.0, 13.0) and hall.notes == ()
    assert len(hall.scenario.robot) == 12
    assert 11.0 <= min(distances(hall)) <= max(distances(hall)) <= 13.0
    starts = np.array([task.start[:2] for task in hall.scenario.robot])
    assert np.ptp(starts, axis=0).min() > 0.8 * side  # all over the hall


@pytest.mark.parametrize("side", [80, 100, 150])
def test_so_do_halls_of_millions_of_cells(side) -> None:
    field = distance_field(~closed(20 * side, 20 * side), STEP)
    tasks, limits, note = find_tasks(field, STEP, 0.17, None, "hall")
    assert (len(tasks), limits, note) == (12, (11.0, 13.0), "")


def test_random_layouts_are_searched_only_when_they_say_so() -> None:
    field = distance_field(~closed(600, 600), STEP)
    find_tasks(field, STEP, 0.17, (11.0, 13.0), "hall")
    with pytest.raises(UserError, match=r"hall: no connected start and goal that are 11 to 13 m"):
        find_tasks(field, STEP, 0.17, (11.0, 13.0), "hall", searching=False)


def test_rooms_of_every_length_get_tasks() -> None:
    for columns in range(56, 300):
        room = built(closed(28, columns, 2), pedestrians={"count": [0, 0]})
        nearest, farthest = room.scenario.start_goal_distance or (0.0, 0.0)
        assert 1.4 <= nearest < farthest
        reached = distances(room, 5)
        assert nearest <= min(reached) and max(reached) <= farthest
        diagonal = np.hypot((columns - 4) * STEP - 2 * 0.27, 24 * STEP - 2 * 0.27)
        assert farthest <= diagonal + 0.1
        assert (nearest == 11.0) == (room.notes == ())
        assert nearest == 11.0 or diagonal < 13.5
        kept = "the map offers no 11 m" if diagonal < 10.9 else "11 m"
        assert nearest == 11.0 or kept in room.notes[0]


@pytest.mark.parametrize("rows", [15, 16, 17, 19, 24])  # 0.55 m between the walls, and more
@pytest.mark.parametrize("columns", [60, 61, 120, 251, 262, 299])
def test_narrow_corridors_get_tasks(rows, columns) -> None:
    corridor = built(closed(rows, columns, 2), pedestrians={"count": [0, 0]})
    nearest, farthest = corridor.scenario.start_goal_distance or (0.0, 0.0)
    reached = distances(corridor)
    assert nearest <= min(reached) and max(reached) <= farthest
    assert (nearest == 11.0) == (columns > 250)


def test_a_wanted_distance_is_found_wherever_it_is_offered() -> None:
    for columns in (250, 262, 280):  # regions in its corners are at most 11.2 m apart
        room = closed(60, columns, 2)
        along = (columns - 4) * STEP - 2 * 0.27
        offered = built(room, start_goal_distance=[along - 0.6, along])
        assert along - 0.6 <= min(distances(offered)) <= max(distances(offered)) <= along
        with pytest.raises(UserError, match=r"are 20 to 21 m apart; its largest connected floor"):
            built(room, start_goal_distance=[20, 21])
    # The largest floor is not the longest.
    floor = np.zeros((220, 420), bool)
    floor[4:184, 4:184] = True
    floor[190:210, 4:404] = True
    corridor = built(floor, start_goal_distance=[14, 16])
    assert min(task.start[1] for task in corridor.scenario.robot) > 9.5


def arena() -> np.ndarray:
    """Like TurtleBot3's world: a hexagon of about 4 x 4 m, nine pillars a metre apart."""
    side = np.arange(120) * STEP - 3.0
    x, y = np.meshgrid(side, side)
    floor = np.maximum(abs(x), 0.5 * abs(x) + 0.866 * abs(y)) < 2.2
    for column in (-1.1, 0.0, 1.1):
        for row in (-1.1, 0.0, 1.1):
            floor &= np.hypot(x - column, y - row) > 0.16
    return floor


def test_a_first_map_of_ros_gets_people() -> None:
    small = built(arena())
    assert small.scenario.pedestrians.count == (1, 1)
    routes = small.scenario.pedestrians.routes
    assert len(routes) >= 3
    lengths = []
    for route in routes:
        ways = [np.array([*route.start[:2]]), *map(np.array, route.via), np.array(route.goal[:2])]
        lengths.append(sum(np.hypot(*(b - a)) for a, b in pairwise(ways)))
        assert all(room_between(small, a, b) > 0.2 for a, b in pairwise(ways))
    assert 2.0 < min(lengths) < 4.0
    assert small.notes[0].startswith("routes of people from ")
    assert small.notes[0].endswith("; 1 person instead of 12 to 16 people: 7 m² of floor")
    world = World(small, WorldConfig())
    world.reset(2, 0, 0)
    before = world.pedestrian_position.copy()
    for _ in range(40):
        world.begin_step(0.0, 0.0)
        world.tick()
    assert np.hypot(*(world.pedestrian_position - before).T).max() > 0.5


def test_a_closet_has_no_people() -> None:
    closet = built(closed(50, 50, 4), start_goal_distance=[0.6, 2.0])
    assert closet.scenario.pedestrians.count == (0, 0)
    assert closet.notes == ("no people instead of 12 to 16 people: no two free places 2 m apart",)


def test_impossible_maps_are_refused(tmp_path) -> None:
    path = write_map(tmp_path, building(9.0, 6.0))
    with pytest.raises(UserError, match=r"scenario b: no connected start and goal that are 11 to"):
        Place.build(scenario(path, start_goal_distance=[11, 13]))
    path = write_map(tmp_path, building(1.5, 1.5))
    with pytest.raises(UserError, match=r"scenario b: "):
        Place.build(scenario(path))
    floor = building()
    floor[:, 300:304] = False  # cut in two
    path = write_map(tmp_path, floor)
    x, y = ORIGIN
    ends = {
        "start": (x + 8.5, y + 9.0, x + 9.5, y + 10.5),
        "goal": (x + 20.5, y + 9.0, x + 21.5, y + 10.5),
    }
    with pytest.raises(UserError, match=r"robot\.0 has no connected start and goal: no path leads"):
        Place.build(scenario(path, robot=[ends]))
    people = {"count": [1, 1], "routes": [ends]}
    with pytest.raises(UserError, match=r"pedestrians\.routes\.0 has no path from \[-3\.8"):
        Place.build(scenario(path, pedestrians=people))
    with pytest.raises(UserError, match=r"away\.yaml: no such file"):
        Place.build(scenario(tmp_path / "away.yaml"))


def test_the_office_is_read_from_beside_its_scenario(monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    office = Place.build(load_scenario("office"))
    assert office.map_origin == pytest.approx((-4.0, -2.0))
    assert office.scenario.start_goal_distance == (11.0, 13.0)
    assert office.grid.unknown is None  # the unknown rim is cut off
