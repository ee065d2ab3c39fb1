"""The compiled rollouts against ones that are driven in small pieces."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lndrl.config import RunConfig, TaskConfig
from lndrl.navigation import Observation, action_table
from lndrl.planners import PredictiveConfig, PredictivePlanner
from lndrl.planners.rollouts import arc_poses, decide, near_points
from tests.lndrl.planners.seen import BEARINGS, RANGE

Floats = NDArray[np.float64]
ROBOT = 0.17


@cache
def paths(p: PredictiveConfig) -> tuple[Floats, Floats]:
    """Poses (A, A, T, 3) of all pairs, and their times (T,), by small straight pieces."""
    table = action_table(TaskConfig())
    pieces = 100
    poses: list[Floats] = []
    times: list[float] = []
    pose = np.zeros((len(table), len(table), 3))
    for action, horizon in (
        (table[:, None], p.first_horizon),
        (table[None, :], p.second_horizon),
    ):
        count = math.ceil(horizon / p.sample_period - 1e-9)
        for _ in range(count):
            step = horizon / count / pieces
            for _ in range(pieces):
                middle = pose[..., 2] + 0.5 * step * action[..., 1]
                pose = pose + step * np.stack(
                    np.broadcast_arrays(
                        action[..., 0] * np.cos(middle),
                        action[..., 0] * np.sin(middle),
                        action[..., 1],
                    ),
                    axis=-1,
                )
            poses.append(pose)
            times.append((times[-1] if times else 0.0) + horizon / count)
    return np.stack(poses, axis=2), np.array(times)


def walls_slowly(observation: Observation, p: PredictiveConfig) -> Floats:
    """Echoes that are walls, (P, 2), near or far."""
    ranges = observation.scan[0] * (RANGE / 65535)
    points: list[Floats] = []
    for k, distance in enumerate(ranges):
        beside = [abs(ranges[n] - distance) for n in (k - 1, k + 1) if 0 <= n < len(ranges)]
        point = distance * np.array([np.cos(BEARINGS[k]), np.sin(BEARINGS[k])])
        people = observation.pedestrians[0, : observation.pedestrian_count[0], :2]
        if observation.scan[0, k] == 65535 or min(beside) > 0.2 or distance > 2.5:
            continue
        if len(people) and np.hypot(*(people - point).T).min() < p.people_hide:
            continue
        if points and np.hypot(*(points[-1] - point)) < p.spacing:
            continue
        points.append(point)
    return np.array(points).reshape(-1, 2)


def costs_slowly(observation: Observation, p: PredictiveConfig) -> tuple[Floats, float]:
    """Costs (A, A) of all pairs; how far (m) the nearest decision by a threshold was from it."""
    table = action_table(TaskConfig())
    poses, times = paths(p)
    goal = observation.goal[0, :2].astype(np.float64)
    people = observation.pedestrians[0, : observation.pedestrian_count[0]].astype(np.float64)
    walls = walls_slowly(observation, p)
    turned = np.abs(table[:, 1])
    far = np.full(poses.shape[:3], np.inf)
    wall, person = far.copy(), far.copy()
    for point in walls:
        wall = np.minimum(wall, np.hypot(*np.moveaxis(poses[..., :2] - point, -1, 0)) - ROBOT)
    for x, y, vx, vy in people:
        there = np.stack((x + vx * times, y + vy * times), axis=-1)
        apart = np.hypot(*np.moveaxis(poses[..., :2] - there, -1, 0))
        person = np.minimum(person, apart - ROBOT - p.person_radius)
    left = goal - poses[..., :2]
    distance = np.hypot(left[..., 0], left[..., 1])
    past = np.arctan2(left[..., -1, 1], left[..., -1, 0]) - poses[..., -1, 2]
    past = np.abs(np.angle(np.exp(1j * past)))
    doubt = min(
        np.abs(distance - 0.5).min(),
        np.abs(wall - p.wall_margin).min(),
        np.abs(person - p.person_margin).min(),
    )
    costs = np.empty(distance.shape[:2])
    first = round(p.first_horizon / p.sample_period)
    for i, j in np.ndindex(costs.shape):
        there = np.flatnonzero(distance[i, j] < 0.5)
        driven = there[0] + 1 if len(there) else len(times)
        if len(there):
            cost = 10.0 * 0.5 - 10.0 * 0.6 * (times[-1] - times[there[0]])
            second = driven > first
            cost *= p.goal_weight / 10.0
        else:
            cost, second = p.goal_weight * distance[i, j, -1] + p.heading_weight * past[i, j], True
        turn = p.first_horizon * turned[i] + (p.second_horizon * turned[j] if second else 0.0)
        cost += p.turning_weight * turn
        w, q = wall[i, j, :driven], person[i, j, :driven]
        cost += p.wall_weight * max(0.0, 1.0 - w.min() / p.wall_reach)
        cost += p.person_weight * max(0.0, 1.0 - q.min() / p.person_reach)
        depth = np.zeros(driven)
        for clearance, margin in ((w, p.wall_margin), (q, p.person_margin)):
            near = 0.3 + 0.7 * np.minimum(1.0 - clearance / margin, 1.0)
            depth = np.maximum(depth, np.where(clearance < margin, near, 0.0))
        cost += (p.touch_weight * depth * np.exp(-times[:driven] / p.touch_fade)).max()
        costs[i, j] = cost
    return costs, doubt


def random_observation(seed: int, nearness: float, people: int, goal: float) -> Observation:
    """Pieces of wall at random distances, some beams without an echo, people, a goal."""
    random = np.random.default_rng(seed)
    observation = Observation.zeros(1)
    pieces = random.uniform(0.15, 1.0, 24) * nearness
    ranges = np.repeat(np.where(random.random(24) < 0.4, RANGE, pieces), 30)
    ranges += random.normal(size=720) * 0.02
    ranges[random.random(720) < 0.05] = 0.1
    observation.scan[0] = np.rint(np.clip(ranges, 0.0, RANGE) / RANGE * 65535)
    observation.scan[0, 0] = 65535  # has no mirror image
    observation.pedestrian_count[0] = people
    observation.pedestrians[0, :people, :2] = random.normal(size=(people, 2)) * 1.5
    observation.pedestrians[0, :people, 2:] = random.normal(size=(people, 2)) * 0.4
    observation.goal[0, :2] = random.normal(size=2) * goal
    return observation


SCENES = {
    "seed": st.integers(0, 2**32 - 1),
    "nearness": st.sampled_from([0.5, 1.5, 6.0]),
    "people": st.integers(0, 6),
    "goal": st.sampled_from([0.6, 1.5, 6.0]),
}


@settings(max_examples=25, deadline=None)
@given(**SCENES)
def test_costs_are_those_of_the_slow_twin(
    config: RunConfig, seed: int, nearness: float, people: int, goal: float
) -> None:
    observation = random_observation(seed, nearness, people, goal)
    parameters = PredictiveConfig(turning_weight=0.7)
    slow, doubt = costs_slowly(observation, parameters)
    assume(doubt > 1e-5)
    costs = PredictivePlanner(config, parameters).costs(observation, np.arange(1))[0]
    # The slow arcs are exact to about 1e-6 m, and what a metre costs at most is tens.
    np.testing.assert_allclose(costs, slow.min(axis=1), atol=2e-4)


@settings(max_examples=40, deadline=None)
@given(**SCENES)
def test_what_is_not_followed_to_its_end_is_not_the_cheapest(
    config: RunConfig, seed: int, nearness: float, people: int, goal: float
) -> None:
    observation = random_observation(seed, nearness, people, goal)
    planner = PredictivePlanner(config)
    chosen = planner.costs(observation, np.arange(1)).argmin()
    acted = planner.act(observation, np.arange(1))[0]
    np.testing.assert_array_equal(acted, action_table(config.task)[chosen])


@settings(max_examples=40, deadline=None)
@given(**SCENES)
def test_a_mirrored_place_has_mirrored_costs(
    config: RunConfig, seed: int, nearness: float, people: int, goal: float
) -> None:
    plain = random_observation(seed, nearness, people, goal)
    mirrored = plain.copy()
    mirrored.scan[0, 1:] = plain.scan[0, :0:-1]
    mirrored.pedestrians[..., 1::2] *= -1.0
    mirrored.goal[..., 1] *= -1.0
    # Thinning keeps the first of neighbours, from right to left.
    planner = PredictivePlanner(config, PredictiveConfig(spacing=0.0))
    costs, other = (planner.costs(each, np.arange(1))[0] for each in (plain, mirrored))
    np.testing.assert_allclose(other.reshape(4, 7), costs.reshape(4, 7)[:, ::-1], atol=1e-6)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(1, 6))
def test_rows_do_not_see_each_other(config: RunConfig, seed: int, rows: int) -> None:
    each = [random_observation(seed + k, 1.5, k, 3.0) for k in range(rows)]
    planner = PredictivePlanner(config)
    together = planner.costs(Observation.concatenate(each), np.arange(rows))
    acted = planner.act(Observation.concatenate(each), np.arange(rows))
    for k in reversed(range(rows)):
        np.testing.assert_array_equal(together[k], planner.costs(each[k], np.array([k]))[0])
        np.testing.assert_array_equal(acted[k], planner.act(each[k], np.array([k]))[0])


NUMBERS = [0.0, 1e-3, 0.3, 1.0, 1e30, -1.0, math.nan, math.inf, -math.inf]


@settings(max_examples=60, deadline=None)
@given(data=st.data(), seed=st.integers(0, 2**32 - 1))
def test_whatever_comes_in_nothing_is_written_outside(
    config: RunConfig, data: st.DataObject, seed: int
) -> None:
    random = np.random.default_rng(seed)
    rows, beams, most = (data.draw(st.integers(0, n)) for n in (3, 40, 5))
    planner = PredictivePlanner(config)

    def guarded(*shape: int) -> tuple[Floats, Floats]:
        whole = np.full(int(np.prod(shape)) + 16, 7.0)
        return whole, whole[8 : len(whole) - 8].reshape(shape)

    whole_out, out = guarded(data.draw(st.integers(0, 3)), data.draw(st.integers(0, 28)))
    whole_points, points = guarded(data.draw(st.integers(0, 40)), 2)
    whole_base, base = guarded(28)
    ends = np.full(44, 7)
    whole_features, features = guarded(data.draw(st.integers(0, 5)), 2)
    whole_effort, effort = guarded(*[data.draw(st.integers(0, 5))] * 2)
    whole_detours, detours = guarded(*[data.draw(st.integers(0, 5))] * 2)
    people = random.choice(NUMBERS, (rows, most, 4)).astype(np.float32)
    decide(
        random.integers(0, 65536, (rows, beams)).astype(np.uint16),
        random.choice(NUMBERS, (data.draw(st.integers(0, 40)), 2)), 12 / 65535, 1e3,
        data.draw(st.sampled_from([1.0, 1e3])), 0.0, people,
        random.integers(0, 256, rows).astype(np.uint8), 0.4,
        random.choice(NUMBERS, (data.draw(st.integers(0, 3)), 6)).astype(np.float32),
        planner._rollouts, planner._prices,
        random.choice(NUMBERS, data.draw(st.integers(0, 3))),
        random.choice(NUMBERS, (data.draw(st.integers(0, 3)), data.draw(st.integers(0, 28)))),
        data.draw(st.booleans()), points, base, ends[8:-8],
        effort, detours, features, out,
    )  # fmt: skip
    for whole in (
        whole_out,
        whole_points,
        whole_base,
        whole_effort,
        whole_detours,
        whole_features,
        ends,
    ):
        assert (whole[:8] == 7).all() and (whole[len(whole) - 8 :] == 7).all()


def test_arcs_are_exact_down_to_no_turn() -> None:
    """Against the closed form, and against a straight line for turns too small to matter."""
    times = np.array([0.5, 2.0])
    for w in (0.9, -0.3):
        x, y, yaw = arc_poses(np.array([[0.6, w]]), times)[0].T
        np.testing.assert_allclose(x, 0.6 / w * np.sin(w * times), atol=1e-14)
        np.testing.assert_allclose(y, 0.6 / w * (1 - np.cos(w * times)), atol=1e-14)
        np.testing.assert_allclose(yaw, w * times)
    for w in (0.0, 1e-12):
        x, y, _ = arc_poses(np.array([[0.6, w]]), times)[0].T
        np.testing.assert_allclose(x, 0.6 * times, atol=1e-14)
        np.testing.assert_allclose(y, 0.0, atol=1e-11)


def test_points_are_echoes_of_walls_within_reach() -> None:
    directions = np.stack((np.cos(BEARINGS), np.sin(BEARINGS)), axis=1)
    scan: NDArray[Any] = np.full(720, 65535, np.uint16)
    scan[100:110] = 1000
    scan[200:210] = 2000
    scan[300] = 500  # nobody bears it out
    scan[400:410] = 30000  # out of reach
    people = np.array([[*(directions[204] * 2000e-3), 0.0, 0.0]])
    out = np.zeros((720, 2))
    assert near_points(scan, directions, 1e-3, 5.0, 0.0, people, 1, 0.4, out) == 10
    np.testing.assert_allclose(out[:10], directions[100:110])
    assert near_points(scan, directions, 1e-3, 5.0, 0.0, people, 0, 0.4, out) == 20
    # Beams are 4.4 mm apart at 1 m: every third keeps 1 cm.
    assert near_points(scan, directions, 1e-3, 5.0, 0.01, people, 1, 0.4, out) == 4


@pytest.mark.parametrize("period", [0.1, 0.3])
def test_a_horizon_ends_where_it_says(config: RunConfig, period: float) -> None:
    parameters = PredictiveConfig(sample_period=period, first_horizon=0.7, second_horizon=1.0)
    rollouts = PredictivePlanner(config, parameters)._rollouts
    assert rollouts.first_times[-1] == pytest.approx(0.7)
    assert rollouts.second_times[-1] == pytest.approx(1.7)
    assert np.diff(rollouts.second_times).max() <= period + 1e-9
