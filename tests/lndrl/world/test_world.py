from typing import Any

import numpy as np
import pytest

from lndrl.config import WorldConfig, load_scenario
from lndrl.scenario import Scenario
from lndrl.world import Place, World, WorldBatch
from lndrl.world import place as place_module


@pytest.fixture(scope="module")
def place():
    return Place.build(load_scenario("hybrid"))


def episode(world, steps=25, seed=4, world_id=1, number=7, ids=None):
    """Everything that an episode shows, bit by bit."""
    world.reset(seed, world_id, number)
    seen = [world.goal.copy(), world.start_pose.copy()]
    for k in range(steps):
        world.begin_step(0.2 * (k % 4), 0.3 * (k % 7 - 3))
        for _ in range(3):
            world.tick()
            seen.append(world.scan_sparse(12))
        world.tick()
        seen += [world.scan(), world.pose_true.copy(), world.pose_odometry.copy()]
        seen += [world.pedestrian_position.copy(), world.pedestrian_velocity.copy()]
        seen.append(world.leg_position.copy())
    return b"".join(a.tobytes() for a in seen)


def test_the_same_seeds_replay_bit_for_bit_whatever_ran_before(place):
    a, b = World(place, WorldConfig()), World(place, WorldConfig())
    first = episode(a)
    episode(b, steps=5, number=3)
    assert episode(b) == first
    assert episode(a) == first


@pytest.mark.parametrize(("draw", "fewer"), [("step", 1.0), ("reading", 0.5)])
def test_slip_that_is_drawn_for_every_reading_averages_out(place, draw, fewer):
    """Four independent factors in a control step deviate half as much as one that lasts."""
    world = World(place, WorldConfig(odometry_draw=draw))
    world.reset(4, 1, 7)
    turned = []
    for k in range(2000):
        before = world.pose_odometry.copy()
        world.begin_step(0.0, 0.9)
        factors = set()
        for _ in range(4):
            world.tick()
            factors.add(float(world.robot.slip[1]))
        assert len(factors) == (1 if draw == "step" else 4), k
        turned.append(np.angle(np.exp(1j * (world.pose_odometry[2] - before[2]))) / 0.36)
    # The deviation of 2,000 draws is known to 1.6 %.
    assert np.std(turned) == pytest.approx(0.1 * fewer, rel=0.06)


@pytest.mark.parametrize("other", [{"seed": 5}, {"world_id": 2}, {"number": 8}])
def test_other_seeds_differ(place, other):
    world = World(place, WorldConfig())
    assert episode(world, steps=1) != episode(world, steps=1, **other)


def test_reset_draws_free_starts_at_the_scenarios_distance(place):
    world = World(place, WorldConfig())
    counts, headings = set(), []
    nearest, farthest = place.scenario.start_goal_distance
    for number in range(60):
        world.reset(1, 0, number)
        distance = np.hypot(*(world.goal - world.start_pose[:2]))
        assert nearest <= distance <= farthest
        assert place.room(*world.start_pose[:2]) >= 0.27
        assert place.room(*world.goal) >= 0.27
        assert (world.pose_true == world.start_pose).all() and not world.pose_odometry.any()
        counts.add(world.pedestrian_count)
        headings.append(world.start_pose[2])
        gap = np.hypot(*(world.pedestrian_position - world.start_pose[:2]).T)
        assert gap.min() >= 1.0
        assert all(place.room(*p) >= 0.3 for p in world.pedestrian_position)
        assert world.pedestrian_position.shape == (world.pedestrian_count, 2)
        assert world.leg_position.shape == (2 * world.pedestrian_count, 2)
    assert counts <= set(range(18, 23)) and len(counts) == 5
    assert min(headings) < -2 and max(headings) > 2
    assert -np.pi <= min(headings) and max(headings) < np.pi


def test_a_fresh_episode_never_starts_in_contact(place):
    world = World(place, WorldConfig())
    for number in range(40):
        world.reset(2, 0, number)
        world.begin_step(0.0, 0.0)
        assert not world.tick()


def test_a_tick_moves_time_robot_and_people(place):
    world = World(place, WorldConfig(odometry_deviation=0.0))
    world.reset(1, 0, 0)
    before = world.pedestrian_position.copy()
    world.begin_step(0.4, 0.3)
    assert (world.command == [0.4, 0.3]).all()
    for _ in range(4):
        world.tick()
    assert world.time == pytest.approx(0.4)
    x, y, yaw = world.start_pose
    turned = yaw + 0.12
    want = [
        x + 0.4 / 0.3 * (np.sin(turned) - np.sin(yaw)),
        y - 0.4 / 0.3 * (np.cos(turned) - np.cos(yaw)),
    ]
    assert world.pose_true[:2] == pytest.approx(want)
    assert np.cos(world.pose_true[2] - turned) == pytest.approx(1.0)
    # Without slip the odometer tells the same path from its own origin.
    forward = [0.4 / 0.3 * np.sin(0.12), 0.4 / 0.3 * (1 - np.cos(0.12)), 0.12]
    assert world.pose_odometry == pytest.approx(forward)
    walked = np.hypot(*(world.pedestrian_position - before).T)
    assert walked.max() > 0.1 and walked.max() <= 0.5 * 0.4 + 1e-9


def test_slip_is_drawn_once_per_step(place):
    world = World(place, WorldConfig())
    world.reset(1, 0, 0)
    deltas = []
    for _ in range(20):
        world.begin_step(0.4, 0.0)
        step = []
        for _ in range(4):
            old = world.pose_odometry.copy()
            world.tick()
            step.append(np.hypot(*(world.pose_odometry - old)[:2]))
        assert step == pytest.approx([step[0]] * 4)
        deltas.append(step[0])
    assert np.std(deltas) == pytest.approx(0.004, rel=0.5)


def test_scans_have_the_lasers_shape_and_range(place):
    world = World(place, WorldConfig())
    world.reset(1, 0, 0)
    scan, sparse = world.scan(), world.scan_sparse(12)
    assert scan.shape == (720,) and scan.dtype == np.float32
    assert sparse.shape == (60,)
    assert scan.min() >= 0.0 and scan.max() <= 12.0
    assert scan is not world.scan()


def test_driving_into_a_wall_is_a_collision_with_a_wall():
    scenario = Scenario.model_validate(
        {
            "name": "box",
            "size": [6.0, 4.0],
            "pedestrians": {"count": [0, 0]},
            "robot": [{"start": [1, 1, 2, 3], "goal": [4, 1, 5, 3]}],
        }
    )
    world = World(Place.build(scenario), WorldConfig())
    world.reset(1, 0, 0)
    assert world.pedestrian_count == 0 and world.leg_position.shape == (0, 2)
    world.pose_true[:] = (5.0, 2.0, 0.0)
    world.begin_step(0.6, 0.0)
    hits = [world.tick() for _ in range(16)]
    assert world.collided_with == "wall"
    first = hits.index(True)
    assert 5.0 + 0.06 * (first + 1) >= 5.9 - 0.17 - 1e-9
    assert 5.0 + 0.06 * first < 5.9 - 0.17


def test_a_leg_is_a_collision_with_a_pedestrian(place):
    world = World(place, WorldConfig())
    world.reset(1, 0, 0)
    world.begin_step(0.0, 0.0)
    world.pose_true[:2] = world.leg_position[0] + [0.1, 0.0]
    assert world.tick()
    hit = world.collided_with
    world.reset(1, 0, 1)
    assert (hit, world.collided_with) == ("pedestrian", "")


def test_walls_are_made_once_per_place_not_once_per_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a second of a process with a large map, and memory for every batch."""
    place = Place.build(load_scenario("hall"))
    made: list[str] = []
    for name in ("wall_edges", "index_edges"):
        real = getattr(place_module, name)

        def counted(*args: Any, name: str = name, real: Any = real) -> Any:
            made.append(name)
            return real(*args)

        monkeypatch.setattr(place_module, name, counted)
    batches = [WorldBatch(place, WorldConfig(), worlds) for worlds in (1, 2, 3)]
    assert made == ["wall_edges", "index_edges", "index_edges"]  # people's reach, the robot's
    first = batches[0].setting
    for other in (batch.setting for batch in batches[1:]):
        assert other.solid.members is first.solid.members
        assert other.surroundings.walls.members is first.surroundings.walls.members
    assert first.solid.edges is first.surroundings.walls.edges


def test_a_robot_with_limits_gains_speed_and_brakes(place: Place) -> None:
    limited = World(place, WorldConfig.model_validate({"robot": "turtlebot2"}))
    free = World(place, WorldConfig())
    for world in (limited, free):
        world.reset(0, 0, 0)
        world.begin_step(0.6, 0.9)
    driven: dict[int, list[float]] = {id(limited): [], id(free): []}
    for tick in range(10):
        for world in (limited, free):
            if tick == 7:
                world.begin_step(0.0, 0.0)
            before = world.pose_true.copy()
            world.tick()
            driven[id(world)].append(float(np.hypot(*(world.pose_true - before)[:2])))
    expected = 0.1 * np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.6, 0.5, 0.4, 0.3])
    assert driven[id(limited)] == pytest.approx(expected, rel=1e-2)
    assert driven[id(free)] == pytest.approx([0.06] * 7 + [0.0] * 3, rel=1e-2)
    limited.reset(0, 0, 1)
    assert limited.robot.velocity.tolist() == [0.0, 0.0]
