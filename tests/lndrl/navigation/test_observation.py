"""Quantised scans, people in view, the goal as believed, and the struct of arrays."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.navigation.observation import (
    Observation,
    dequantise,
    goal_vector,
    pedestrians_in_view,
    push_scan,
    quantise,
    wrap_angle,
)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.floats(0.0, 12.0, width=32), min_size=1, max_size=50),
    st.sampled_from([12.0, 30.0]),
)
def test_quantise_is_the_nearest_count(ranges: list[float], range_max: float) -> None:
    metres = np.array(ranges, np.float32)
    counts = quantise(metres, range_max)
    expected = np.rint(metres.astype(np.float64) * (65535 / range_max)).astype(np.uint16)
    np.testing.assert_array_equal(counts, expected)
    assert np.abs(dequantise(counts, range_max) - metres).max() <= range_max / 65535 * 0.51
    np.testing.assert_array_equal(quantise(dequantise(counts, range_max), range_max), counts)


def test_quantise_takes_anything() -> None:
    odd = np.array([[np.nan, np.inf, -np.inf], [-1.0, 13.0, 12.0]], np.float32)
    assert quantise(odd, 12.0).tolist() == [[65535, 65535, 0], [0, 65535, 65535]]


@settings(max_examples=50, deadline=None)
@given(st.floats(-50.0, 50.0))
def test_wrap_angle(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -np.pi <= wrapped < np.pi
    assert np.isclose(np.cos(wrapped), np.cos(angle)) and np.isclose(np.sin(wrapped), np.sin(angle))


def slow_people(pose: np.ndarray, position: np.ndarray, velocity: np.ndarray, capacity: int):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    to_robot = np.array([[c, s], [-s, c]])
    relative = (position - pose[:2]) @ to_robot.T
    seen = np.flatnonzero((np.abs(relative) <= 3.0).all(axis=1))
    order = seen[np.argsort((relative[seen] ** 2).sum(axis=1), kind="stable")][:capacity]
    return np.concatenate([relative[order], velocity[order] @ to_robot.T], axis=1)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), number=st.integers(0, 40), capacity=st.sampled_from([3, 24]))
def test_people_in_view_near_to_far(seed: int, number: int, capacity: int) -> None:
    rng = np.random.default_rng(seed)
    pose = np.array([5.0, 6.0, rng.uniform(-np.pi, np.pi)])
    position = rng.uniform(1.0, 10.0, (number, 2))
    velocity = rng.normal(0.0, 0.4, (number, 2))
    out = np.full((capacity, 4), 9.0, np.float32)
    count = pedestrians_in_view(pose, position, velocity, 6.0, out)
    expected = slow_people(pose, position, velocity, capacity)
    assert count == len(expected)
    np.testing.assert_allclose(out[:count], expected, atol=1e-5)
    assert not out[count:].any()


def test_people_are_turned_into_the_robot_frame() -> None:
    pose = np.array([1.0, 1.0, np.pi / 2])  # facing up the map
    out = np.zeros((4, 4), np.float32)
    position, velocity = np.array([[1.0, 3.0]]), np.array([[0.5, 0.0]])
    assert pedestrians_in_view(pose, position, velocity, 6.0, out) == 1
    # two metres ahead, walking to the robot's right
    np.testing.assert_allclose(out[0], [2.0, 0.0, 0.0, -0.5], atol=1e-6)


def test_goal_vector_frames_and_limits() -> None:
    out = np.zeros(6, np.float32)
    pose = np.array([2.0, 1.0, np.pi / 2])
    variance = np.array([0.1, 50.0, np.nan])
    goal_vector(pose, variance, np.array([2.0, 4.0]), np.pi / 4, 10.0, out)
    np.testing.assert_allclose(out, [3.0, 0.0, -np.pi / 4, 0.1, 10.0, 10.0], atol=1e-6)
    goal_vector(np.array([0.0, 0.0, 3.0]), variance, np.array([1.0, 0.0]), -3.0, 10.0, out)
    assert np.isclose(out[2], 2 * np.pi - 6.0)  # wrapped the short way round


def numbered_observation(shape: tuple[int, ...]) -> Observation:
    made = Observation.zeros(shape, max_pedestrians=5, beams=7)
    for array in (made.scan, made.pedestrians, made.pedestrian_count, made.goal):
        array[...] = np.arange(array.size).reshape(array.shape)
    return made


def same(a: Observation, b: Observation) -> bool:
    pairs = zip(vars(a).values(), vars(b).values(), strict=True)
    return all(np.array_equal(x, y) and x.dtype == y.dtype for x, y in pairs)


def test_take_put_reshape_copy() -> None:
    whole = numbered_observation((3, 4))
    assert whole.shape == (3, 4) and len(whole) == 3
    flat = whole.flatten()
    assert flat.shape == (12,)
    assert same(flat.take(1 * 4 + 2), whole.take((1, 2)))
    assert same(flat.reshape(3, 4), whole) and same(flat.reshape(3, -1), whole)
    picked = flat.take(np.array([5, 0]))
    assert same(picked.take(0), whole.take((1, 1)))
    target = Observation.zeros(2, 5, 7)
    target.put(slice(None), picked)
    assert same(target, picked)
    target.scan[:] = 0
    assert not same(target, picked)
    twin = whole.copy()
    twin.goal += 1
    assert not same(twin, whole)
    assert same(Observation.concatenate([flat.take(slice(0, 5)), flat.take(slice(5, 12))]), flat)


def test_row_view_writes_through() -> None:
    whole = Observation.zeros(3, 5, 7)
    row = whole.take((1, Ellipsis))
    assert row.shape == ()
    row.pedestrian_count[...] = 4
    row.goal[:] = 2.0
    assert whole.pedestrian_count.tolist() == [0, 4, 0] and whole.goal[1].tolist() == [2.0] * 6


@settings(max_examples=40, deadline=None)
@given(
    frames=st.integers(1, 4), beams=st.integers(1, 9), steps=st.integers(1, 6), again=st.booleans()
)
def test_scans_are_kept_oldest_first_and_begin_with_the_first(
    frames: int, beams: int, steps: int, again: bool
) -> None:
    rng = np.random.default_rng(frames * 100 + beams)
    shown = rng.integers(0, 65536, frames * beams).astype(np.uint16)
    slow: list[np.ndarray] = []
    for step in range(steps):
        scan = rng.uniform(0, 12, beams).astype(np.float32)
        begun = step == 0 or (again and step == 3)
        slow = [quantise(scan, 12.0)] * frames if begun else [*slow[1:], quantise(scan, 12.0)]
        push_scan(scan, 65535 / 12.0, begun, shown)
        np.testing.assert_array_equal(shown, np.concatenate(slow))
