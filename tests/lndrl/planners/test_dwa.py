from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.navigation import Observation
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.planners import DWAConfig, DWAPlanner, planner_source
from lndrl.planners.dwa import best_velocities, best_velocity

PERIOD, STEPS, RADIUS, FASTEST = 0.4, 4, 0.17, 0.6
RANGE = 12.0


def costs_slowly(
    linear: NDArray[Any],
    angular: NDArray[Any],
    goal: NDArray[Any],
    points: NDArray[Any],
    weights: tuple[float, float, float, float],
) -> NDArray[np.float64]:
    """Costs (V, W), infinite where an arc touches a point; each arc by small straight pieces."""
    result = np.full((len(linear), len(angular)), np.inf)
    pieces = 200
    for i, v in enumerate(linear):
        for j, w in enumerate(angular):
            pose, path = np.zeros(3), []
            for _ in range(STEPS):
                for _ in range(pieces):
                    middle = pose[2] + 0.5 * w * PERIOD / pieces
                    pose[:2] += v * PERIOD / pieces * np.array([np.cos(middle), np.sin(middle)])
                    pose[2] += w * PERIOD / pieces
                path.append(pose[:2].copy())
            clearance = np.inf
            if len(points):
                apart = np.array(path)[:, None] - points[None]
                clearance = np.linalg.norm(apart, axis=2).min()
            if clearance <= RADIUS or (v < 1e-3 and abs(w) < 1e-3):
                continue
            left = goal - pose[:2]
            past = np.angle(np.exp(1j * (np.arctan2(left[1], left[0]) - pose[2])))
            result[i, j] = (
                weights[0] * np.linalg.norm(left)
                + weights[1] * abs(past)
                + weights[2] * (FASTEST - v)
                + weights[3] / clearance
            )
    return result


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    number=st.integers(0, 40),
    nearness=st.sampled_from([0.3, 1.0, 5.0]),
)
def test_the_kernel_takes_the_cheapest_arc_of_its_slow_twin(
    seed: int, number: int, nearness: float
) -> None:
    random = np.random.default_rng(seed)
    linear = np.sort(random.uniform(0, 0.6, 3))
    angular = np.array([-0.9, *np.sort(random.uniform(-0.9, 0.9, 2)), 0.0])
    goal = random.uniform(-5, 5, 2)
    points = random.normal(size=(number, 2)) * nearness
    weights = tuple(random.uniform(0, 1, 4))
    out = np.zeros(2)
    best_velocity(linear, angular, goal, points, PERIOD, STEPS, RADIUS, weights, FASTEST, out)
    costs = costs_slowly(linear, angular, goal, points, weights)
    if np.isnan(out[0]):
        assert np.isinf(costs).all() or near_a_touch(linear, angular, points)
        return
    chosen = costs[list(linear).index(out[0]), list(angular).index(out[1])]
    # The slow arcs are exact to about 1e-6 m.
    assert chosen <= costs.min() + 1e-5 or near_a_touch(linear, angular, points)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.integers(1, 5),
    frames=st.integers(1, 3),
    resolution=st.sampled_from([0.05, 0.1, 0.2, 0.7]),
    acceleration=st.sampled_from([0.0, 0.5, 5.0]),
)
def test_the_best_of_the_window_is_that_of_numpy_to_the_bit(
    seed: int, rows: int, frames: int, resolution: float, acceleration: float
) -> None:
    """A bench that was recorded must come out again, so a unit in the last place is too much."""
    random = np.random.default_rng(seed)
    limits, window = (0.0, 0.6, -0.9, 0.9), (acceleration, 5.0, 0.2, resolution)
    weights = tuple(random.uniform(0, 1, 4))
    commands = random.uniform([0.0, -0.9], [0.6, 0.9], (rows, 2))
    scan = random.integers(0, SCAN_COUNTS + 1, (rows, frames * 36)).astype(np.uint16)
    scan[random.random(scan.shape) < 0.3] = SCAN_COUNTS  # no echo
    goal = random.uniform(-5, 5, (rows, 6)).astype(np.float32)
    used = np.arange(0, 36, 5) - 36
    bearing = random.uniform(-1.6, 1.6, len(used))
    directions = np.stack((np.cos(bearing), np.sin(bearing)), axis=1)
    out = np.zeros((rows, 2))
    best_velocities(
        commands, scan, goal, used, directions, RANGE, window, limits, PERIOD, STEPS, RADIUS,
        weights, out,
    )  # fmt: skip

    def candidates(now: float, by: float, least: float, most: float, apart: float) -> Any:
        low, high = max(least, now - by * PERIOD), min(most, now + by * PERIOD)
        return np.linspace(low, high, max(1, math.ceil((high - low) / apart - 1e-9)) + 1)

    for i in range(rows):
        ranges = scan[i, used] * (RANGE / SCAN_COUNTS)
        hit = ranges < RANGE * (1.0 - 1e-6)
        expected = np.zeros(2)
        best_velocity(
            candidates(commands[i, 0], acceleration, 0.0, 0.6, 0.2),
            candidates(commands[i, 1], 5.0, -0.9, 0.9, resolution),
            goal[i, :2].astype(np.float64), directions[hit] * ranges[hit, None], PERIOD, STEPS,
            RADIUS, weights, 0.6, expected,
        )  # fmt: skip
        np.testing.assert_array_equal(out[i], expected)


def test_a_beam_that_the_scan_has_not_is_no_obstacle() -> None:
    """The kernel reads nothing beside its arrays, whatever the beams are said to be."""
    scan, out = np.zeros((1, 4), np.uint16), np.zeros((1, 2))
    used = np.array([-5, 4, 2**40, -(2**40)])  # the scan is all walls at 0 m
    best_velocities(
        np.zeros((1, 2)), scan, np.ones((1, 2), np.float32), used, np.ones((4, 2)), RANGE,
        (5.0, 5.0, 0.2, 0.1), (0.0, 0.6, -0.9, 0.9), PERIOD, STEPS, RADIUS, (1.0, 0.5, 0.0, 0.0),
        out,
    )  # fmt: skip
    assert out[0, 0] > 0.0


def near_a_touch(linear: NDArray[Any], angular: NDArray[Any], points: NDArray[Any]) -> bool:
    """Whether some arc passes a point so that rounding decides if it touches."""
    for v in linear:
        for w in angular:
            turned = w * PERIOD * np.arange(1, STEPS + 1)
            radius = v / w if w else math.inf
            path = (
                np.stack((radius * np.sin(turned), radius * (1 - np.cos(turned))), axis=1)
                if w
                else np.stack((v * PERIOD * np.arange(1, STEPS + 1), np.zeros(STEPS)), axis=1)
            )
            apart = np.linalg.norm(path[:, None] - points[None], axis=2)
            if (np.abs(apart - RADIUS) < 1e-5).any():
                return True
    return False


def seen(config: RunConfig, goal: tuple[float, float], blocked: tuple[float, float] | None = None,
         at: float = 0.5) -> Observation:  # fmt: skip
    """One observation: a goal in m, and something at ``at`` m between two bearings (rad)."""
    observation = Observation.zeros(1)
    observation.goal[0, :2] = goal
    observation.scan[:] = SCAN_COUNTS
    if blocked is not None:
        bearing = -math.pi / 2 + np.arange(720) * math.pi / 720
        inside = (bearing >= blocked[0]) & (bearing <= blocked[1])
        observation.scan[0, inside] = round(at / RANGE * SCAN_COUNTS)
    return observation


def first_act(
    config: RunConfig, observation: Observation, parameters: DWAConfig | None = None
) -> tuple[float, float]:
    planner = DWAPlanner(config, parameters)
    planner.reset(0, [7])
    v, w = planner.act(observation, np.arange(1))[0]
    return float(v), float(w)


def test_an_open_way_is_driven_straight_and_fast(config: RunConfig) -> None:
    assert first_act(config, seen(config, (6.0, 0.0))) == pytest.approx((0.6, 0.0), abs=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_turns_to_a_goal_at_the_side_and_behind(config: RunConfig, side: float) -> None:
    v, w = first_act(config, seen(config, (2.0, 3.0 * side)))
    assert w * side > 0.3
    assert v > 0.0
    v, w = first_act(config, seen(config, (-4.0, 1.0 * side)))
    assert w * side == pytest.approx(0.9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_passes_what_stands_in_the_way_on_the_free_side(config: RunConfig, side: float) -> None:
    blocked = (-0.1, 1.2) if side < 0 else (-1.2, 0.1)
    # One who minds little where it looks steers at once; by default it comes nearer first.
    careless = DWAConfig(heading_weight=0.1)
    v, w = first_act(config, seen(config, (6.0, 0.0), blocked, at=1.0), careless)
    assert v == pytest.approx(0.6)
    assert w * side > 0.3
    v, w = first_act(config, seen(config, (6.0, 0.0), blocked, at=0.6))
    assert w * side > 0.3


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_robot_that_stands_before_something_turns(config: RunConfig, side: float) -> None:
    blocked = (-0.1, 1.2) if side < 0 else (-1.2, 0.1)
    assert first_act(config, seen(config, (6.0, 0.0), blocked, at=0.5)) == (0.0, 0.9 * side)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_walls_all_around_end_in_a_turn_to_the_freer_side(config: RunConfig, side: float) -> None:
    observation = seen(config, (6.0, -side), (-2.0, 2.0), at=0.1)
    freer = slice(360, 720) if side > 0 else slice(0, 360)
    observation.scan[0, freer] = round(0.15 / RANGE * SCAN_COUNTS)
    assert first_act(config, observation) == (0.0, 0.9 * side)


def test_a_gap_narrower_than_the_robot_is_not_entered(config: RunConfig) -> None:
    observation = seen(config, (3.0, 0.0))
    bearing = -math.pi / 2 + np.arange(720) * math.pi / 720
    wall = 0.3 / np.maximum(np.cos(bearing), 1e-3)  # m, a wall 0.3 m ahead
    gap = np.abs(0.3 * np.tan(bearing)) < 0.1
    ranges = np.where(gap, RANGE, np.minimum(wall, RANGE))
    observation.scan[0] = np.rint(ranges / RANGE * SCAN_COUNTS)
    v, w = first_act(config, observation)
    # After one period it must still be clear of the edges of the gap.
    assert v * PERIOD * math.cos(w * PERIOD) < 0.3 - math.sqrt(RADIUS**2 - 0.1**2) + 1e-6


def test_the_window_is_what_the_last_command_can_become(config: RunConfig) -> None:
    slow = DWAConfig(linear_acceleration=0.25, angular_acceleration=0.5)
    planner = DWAPlanner(config, slow)
    planner.reset(0, [1, 2])
    goals = Observation.zeros(2)
    goals.scan[:] = SCAN_COUNTS
    goals.goal[:, 0] = 6.0
    speeds = [planner.act(goals, np.arange(2))[:, 0] for _ in range(8)]
    np.testing.assert_allclose(np.diff([0.0, *(s[0] for s in speeds[:6])]), 0.1, atol=1e-9)
    assert speeds[-1].max() <= 0.6 + 1e-12
    # Rows are episodes: one that has ended leaves the memory of the other alone.
    only = planner.act(goals.take(np.array([1])), np.array([1]))
    assert only[0, 0] == pytest.approx(0.6)


def test_variances_and_people_do_not_matter(config: RunConfig) -> None:
    plain, other = seen(config, (3.0, 1.0), (-0.2, 0.4)), seen(config, (3.0, 1.0), (-0.2, 0.4))
    other.goal[:, 2:] = 3.0
    other.pedestrian_count[:] = 2
    other.pedestrians[:, :2] = [1.0, 0.0, -1.0, 0.0]
    assert first_act(config, plain) == first_act(config, other)


def test_it_is_found_by_name(config: RunConfig) -> None:
    assert isinstance(planner_source("dwa").build(config), DWAPlanner)


def test_of_several_scans_the_newest_counts(config: RunConfig) -> None:
    plain = seen(config, (3.0, 1.0), (-0.2, 0.4))
    several = plain.take(np.arange(1))
    several.scan = np.concatenate([np.zeros((1, 1440), np.uint16), plain.scan], axis=1)
    assert first_act(config, several) == first_act(config, plain)
