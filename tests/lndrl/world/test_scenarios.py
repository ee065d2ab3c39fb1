"""The paper's five scenarios keep what their files and parameters §4.7 promise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from lndrl.config import LaserConfig, WorldConfig, load_scenario
from lndrl.maps.outlines import signed_area
from lndrl.maps.paths import leg_room
from lndrl.world import Place, World
from lndrl.world.laser import Laser

PAPER = {
    "hybrid": ((33.0, 20.0), (18, 22)),
    "sparse": ((33.0, 20.0), (4, 4)),
    "corridor": ((30.0, 20.0), (22, 22)),
    "hall": ((20.0, 20.0), (18, 18)),
    "irregular": ((20.0, 20.0), (9, 13)),
}


@pytest.fixture(scope="module", params=list(PAPER))
def place(request) -> Place:
    return Place.build(load_scenario(request.param))


@pytest.fixture(scope="module")
def sparse() -> Place:
    return Place.build(load_scenario("sparse"))


def lattice(box) -> list[np.ndarray]:
    x0, y0, x1, y1 = box
    return [np.array([x, y]) for x in np.linspace(x0, x1, 4) for y in np.linspace(y0, y1, 4)]


def room_between(place, a, b) -> float:
    return leg_room(place.distance, 1.0 / place.grid.resolution, *a, *b)


def nearest(place, laser, x, y, yaw) -> np.ndarray:
    return laser.true_ranges(np.array([x, y, yaw]), np.zeros((0, 2)), 0.1)


def test_sizes_crowds_and_distances_are_the_papers(place) -> None:
    scenario = place.scenario
    assert (scenario.size, scenario.pedestrians.count) == PAPER[scenario.name]
    assert scenario.start_goal_distance == (11.0, 13.0)
    assert len(scenario.robot) >= 3 and len(scenario.pedestrians.routes) >= 5


def test_routes_cross_no_wall(place) -> None:
    for i, route in enumerate(place.scenario.pedestrians.routes):
        stops = [lattice(route.start), *([np.array(p)] for p in route.via), lattice(route.goal)]
        for here, there in pairwise(stops):
            worst = min(room_between(place, a, b) for a in here for b in there)
            assert worst >= 0.4 - 0.5 * place.grid.resolution, f"route {i} from {here[0]}"


def test_episodes_start_without_contact_and_11_to_13_m_from_the_goal(place) -> None:
    world = World(place, WorldConfig())
    legs = WorldConfig().crowd.leg_radius + place.robot_radius
    for number in range(200):
        world.reset(7, 0, number)
        apart = np.hypot(*(world.goal - world.start_pose[:2]))
        assert 11.0 <= apart <= 13.0
        assert place.room(*world.start_pose[:2]) > place.robot_radius
        gaps = np.hypot(*(world.leg_position - world.start_pose[:2]).T)
        assert gaps.min() > legs
        world.begin_step(0.0, 0.0)
        assert not world.tick(), number


def test_people_make_progress_and_stay_out_of_walls(place) -> None:
    world = World(place, WorldConfig())
    moved = []
    for number in range(2):
        world.reset(5, 0, number)
        world.begin_step(0.0, 0.0)
        for _ in range(10):
            before = world.pedestrian_position.copy()
            for _ in range(20):
                world.tick()
            moved += list(np.hypot(*(world.pedestrian_position - before).T))
            assert min(place.room(*p) for p in world.pedestrian_position) > 0.1
    assert np.median(moved) > 0.6  # of 1 m in 2 s; some stand at their goals


def test_outlines_enclose_the_floor(place) -> None:
    assert signed_area(place.outlines[0]) < 0 and all(
        signed_area(o) > 0 for o in place.outlines[1:]
    )
    assert len(place.walls) == sum(len(o) for o in place.outlines)
    assert place.map_origin == (0.0, 0.0) and place.notes == ()


def test_sparse_has_nothing_ahead_in_its_middle(sparse) -> None:
    laser = Laser(LaserConfig(), sparse.rays)
    for y in (9.0, 10.0, 11.0, 12.0):
        for yaw in (0.0, np.pi):
            ahead = nearest(sparse, laser, 16.5, y, yaw)[180:540]  # 90 degrees
            assert (ahead < 12.0).mean() < 0.05
    # Along the south edge features abound: ranges vary from beam to beam.
    south = nearest(sparse, laser, 16.5, 3.5, -np.pi / 2)
    assert np.abs(np.diff(south[south < 11.9])).max() > 0.5


def test_features_of_sparse_lie_beyond_12_m_on_most_sides(sparse) -> None:
    middle = np.array([16.5, 10.0])
    for outline in sparse.outlines[1:]:
        near = np.hypot(*(outline - middle).T).min()
        assert near > 12.0 or outline[:, 1].max() < 1.5  # those of the south edge


def test_corridor_is_walked_both_ways(tmp_path) -> None:
    world = World(Place.build(load_scenario("corridor")), WorldConfig())
    east = []
    for number in range(20):
        world.reset(3, 0, number)
        assert world.pedestrian_count == 22
        assert (
            (world.pedestrian_position[:, 1] > 7) & (world.pedestrian_position[:, 1] < 13)
        ).all()
        east.append((world.pedestrian_velocity[:, 0] > 0).mean())
    assert 0.35 < np.mean(east) < 0.65


def test_hall_is_crossed_in_all_directions() -> None:
    world = World(Place.build(load_scenario("hall")), WorldConfig())
    angles = []
    for number in range(20):
        world.reset(3, 0, number)
        angles += list(np.arctan2(*world.pedestrian_velocity.T[::-1]))
    counts = np.histogram(angles, 8, (-np.pi, np.pi))[0]
    assert counts.min() > 0.03 * len(angles)


def test_irregular_has_irregular_obstacles() -> None:
    obstacles = load_scenario("irregular").obstacles
    assert len(obstacles) >= 12 and all(o.polygon for o in obstacles)
