"""The shipped training scenario keeps its promises."""

from itertools import pairwise

import numpy as np
import pytest

from lndrl.config import LaserConfig, WorldConfig, load_scenario
from lndrl.world import Place, World
from lndrl.world.laser import Laser


@pytest.fixture(scope="module")
def place():
    return Place.build(load_scenario("hybrid"))


def corners_and_inside(box, rng):
    x0, y0, x1, y1 = box
    corners = [(x0, y0), (x0, y1), (x1, y0), (x1, y1)]
    return np.array(corners + list(rng.uniform((x0, y0), (x1, y1), (6, 2))))


def room_between(place, a, b):
    steps = int(np.hypot(*(b - a)) / 0.1) + 2
    return min(place.room(*(a + (b - a) * u)) for u in np.linspace(0, 1, steps))


def test_size_and_crowd(place):
    assert place.scenario.size == (33.0, 20.0)
    assert place.scenario.pedestrians.count == (18, 22)
    assert len(place.scenario.pedestrians.routes) >= 8
    assert place.scenario.start_goal_distance == (11.0, 13.0)


def test_routes_keep_clear_of_obstacles(place):
    rng = np.random.default_rng(0)
    for i, route in enumerate(place.scenario.pedestrians.routes):
        stops = [corners_and_inside(route.start, rng)]
        stops += [np.array([p]) for p in route.via]
        stops.append(corners_and_inside(route.goal, rng))
        for here, there in pairwise(stops):
            worst = min(room_between(place, a, b) for a in here for b in there)
            # The field knows walls to half a cell.
            assert worst >= 0.4 - 0.5 * place.grid.resolution, f"route {i} from {here[0]}"


def test_every_region_of_the_robot_is_one_to_three_metres_wide(place):
    for task in place.scenario.robot:
        assert task.both_ways
        for x0, y0, x1, y1 in (task.start, task.goal):
            assert 1.0 <= x1 - x0 <= 3.0 and 1.0 <= y1 - y0 <= 3.0


def test_density_of_features_is_not_uniform(place):
    """Rays that look along the open part meet nothing; in the rich part nearly all do."""
    laser = Laser(LaserConfig(), place.rays)

    def seen(x, y, yaw):
        ranges = laser.true_ranges(np.array([x, y, yaw]), np.zeros((0, 2)), 0.1)
        ahead = ranges[240:480]  # the middle 60 degrees
        return (ahead < 12.0).mean()

    assert all(seen(x, 10.5, 0.0) < 0.1 for x in (14.0, 17.0, 19.0))
    assert all(seen(x, 10.5, np.pi) < 0.1 for x in (25.0, 28.0, 31.0))
    assert all(seen(x, 10.5, yaw) > 0.9 for x in (5.0, 7.0) for yaw in (np.pi / 2, -np.pi / 2))


def test_straight_ways_are_sometimes_blocked(place):
    world = World(place, WorldConfig())
    blocked = 0
    for number in range(80):
        world.reset(9, 0, number)
        a, b = world.start_pose[:2], world.goal
        blocked += room_between(place, a, b) < 0.17
    assert 5 < blocked < 60


def test_people_keep_walking_outside_walls(place):
    world = World(place, WorldConfig())
    walking = []
    for number in range(3):
        world.reset(5, 0, number)
        world.begin_step(0.0, 0.0)
        for k in range(300):
            world.tick()
            if k % 10 == 0:
                assert min(place.room(*p) for p in world.pedestrian_position) > 0.15
                walking.append((np.hypot(*world.pedestrian_velocity.T) > 0.2).mean())
    assert np.mean(walking) > 0.5
