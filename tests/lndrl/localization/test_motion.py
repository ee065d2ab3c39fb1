"""Odometry motion model against a NumPy twin and its closed-form moments."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from numba import njit

from lndrl.config import REPOSITORY_CONFIGS
from lndrl.localization.angles import difference, sincos, wrap
from lndrl.localization.motion import decompose, deviations, draw_noise, move, scatter
from lndrl.randomness import fill_normals32, stream_state

ALPHA = (0.2, 0.3, 0.4, 0.5)


@njit
def _sincos(angle):
    return sincos(angle)


def cloud_rows(rng, count):
    yaw = rng.uniform(-math.pi, math.pi, count)
    x, y = rng.uniform(-5, 30, (2, count))
    return np.array([x, y, yaw, np.cos(yaw), np.sin(yaw)])


def same_angle(a, b, tolerance=1e-12):
    return np.abs(np.angle(np.exp(1j * (np.asarray(a) - np.asarray(b))))).max() < tolerance


def test_wrap_keeps_the_half_open_interval():
    for angle in [-math.pi, math.pi, 3 * math.pi, -1e-17, 7.0, -100.0, np.nextafter(-math.pi, -9)]:
        wrapped = wrap(angle)
        assert -math.pi <= wrapped < math.pi
        assert same_angle(wrapped, angle)
    assert wrap(math.pi) == -math.pi
    assert difference(-3.1, 3.1) == pytest.approx(2 * math.pi - 6.2)


def test_sincos_matches_the_library():
    for angle in np.random.default_rng(1).uniform(-90, 90, 2000):
        assert _sincos(angle) == pytest.approx((math.sin(angle), math.cos(angle)), abs=1e-14)


def test_decompose_recomposes():
    rng = np.random.default_rng(2)
    for _ in range(200):
        old = rng.uniform(-3, 3, 3)
        new = old + rng.uniform(-1, 1, 3)
        rotation1, translation, rotation2 = decompose(old, new)
        heading = old[2] + rotation1
        step = translation * np.array([math.cos(heading), math.sin(heading)])
        assert np.allclose(old[:2] + step, new[:2], atol=1e-12)
        assert same_angle(heading + rotation2, new[2])


def test_tiny_translation_has_no_direction():
    rotation1, translation, rotation2 = decompose(np.zeros(3), np.array([0.0, 0.0099, 0.4]))
    assert (rotation1, translation, rotation2) == (0.0, 0.0099, pytest.approx(0.4))
    assert decompose(np.zeros(3), np.array([0.0, 0.011, 0.0]))[0] == pytest.approx(math.pi / 2)


def test_variances_are_used_as_deviations():
    first, forward, second = deviations(0.3, 0.06, -0.2, ALPHA)
    assert first == pytest.approx(0.2 * 0.3**2 + 0.3 * 0.06**2)
    assert forward == pytest.approx(0.4 * 0.06**2 + 0.5 * (0.3**2 + 0.2**2))
    assert second == pytest.approx(0.2 * 0.2**2 + 0.3 * 0.06**2)


def test_backward_is_as_certain_as_forward():
    forward = deviations(0.1, 0.2, -0.05, ALPHA)
    backward = deviations(difference(0.1, math.pi), 0.2, difference(-0.05, math.pi), ALPHA)
    assert backward == pytest.approx(forward)


def test_move_matches_twin():
    rng = np.random.default_rng(3)
    rows = cloud_rows(rng, 700)
    for _ in range(20):
        motion = rng.uniform(-3, 3), rng.uniform(0, 1), rng.uniform(-3, 3)
        noise = rng.normal(0, 0.3, (3, 700))
        turn1 = motion[0] - noise[0]
        distance = motion[1] - noise[1]
        heading = rows[2] + turn1
        x = rows[0] + distance * np.cos(heading)
        y = rows[1] + distance * np.sin(heading)
        yaw = heading + motion[2] - noise[2]
        move(rows, 700, motion, noise)
        assert np.allclose(rows[0], x, atol=1e-10)
        assert np.allclose(rows[1], y, atol=1e-10)
        assert same_angle(rows[2], yaw, 1e-10)
        assert (rows[2] >= -math.pi).all() and (rows[2] < math.pi).all()
        assert np.allclose(rows[3:], [np.cos(rows[2]), np.sin(rows[2])], atol=1e-12)


def test_moments_of_drawn_motion():
    count = 40_000
    old, new = np.array([1.0, 2.0, 0.5]), np.array([1.2, 2.1, 0.7])
    motion = decompose(old, new)
    spread = deviations(*motion, ALPHA)
    rows = np.tile(np.array([[3.0], [4.0], [0.5], [math.cos(0.5)], [math.sin(0.5)]]), (1, count))
    noise = np.zeros((3, count))
    draw_noise(noise, count, spread, stream_state(1), np.zeros(count, np.float32))
    move(rows, count, motion, noise)
    along = np.hypot(rows[0] - 3.0, rows[1] - 4.0)
    assert along.mean() == pytest.approx(motion[1], abs=5 * spread[1] / math.sqrt(count))
    assert along.std() == pytest.approx(spread[1], rel=0.02)
    assert rows[2].mean() == pytest.approx(0.7, abs=1e-3)
    assert rows[2].std() == pytest.approx(math.hypot(spread[0], spread[2]), rel=0.02)


def test_noise_is_single_precision_normals_times_the_spread_in_double():
    spread = (0.1, 1 / 3, 1e-3)
    for count in (32, 33, 512):
        noise, normals = np.zeros((3, 544)), np.zeros(544, np.float32)
        state, twin = stream_state(2), stream_state(2)
        draw_noise(noise, count, spread, state, normals)
        for part in range(3):
            drawn = np.zeros(count, np.float32)
            fill_normals32(twin, drawn)
            assert (noise[part, :count] == drawn.astype(np.float64) * spread[part]).all()
        assert (noise[:, count:] == 0.0).all() and (state == twin).all()


def test_scatter_has_the_asked_spread():
    rows = np.zeros((5, 30_000))
    scatter(rows, 30_000, np.array([2.0, 3.0, 1.0]), np.array([0.05, 0.1, 0.2]), stream_state(4))
    assert np.allclose(rows[:3].mean(axis=1), [2.0, 3.0, 1.0], atol=0.006)
    assert np.allclose(rows[:3].std(axis=1), [0.05, 0.1, 0.2], rtol=0.02)
    assert np.allclose(rows[3], np.cos(rows[2]))


def test_the_page_s_noise_per_control_step_is_the_model_s():
    """docs/localization.md: at 0.6 m/s and 0.9 rad/s, by the ticks that are heard."""
    page = (REPOSITORY_CONFIGS.parent / "docs" / "localization.md").read_text("utf-8")
    for name, ticks in (("every tick", (1, 2, 3, 4)), ("`[2, 3, 4]`", (2, 3, 4)),
                        ("`[2, 4]`", (2, 4)), ("`[4]`", (4,))):  # fmt: skip
        poses = [arc(0.1 * tick) for tick in (0, *ticks)]
        noise = np.array(
            [deviations(*decompose(*pair), (0.2,) * 4) for pair in itertools.pairwise(poses)]
        )
        along = 1e3 * np.hypot.reduce(noise[:, 1])
        turning = 1e3 * np.hypot.reduce(noise[:, ::2].ravel())
        row = (
            f"| {name} | {along:.1f} | {100 * along / 24:.0f} % "
            f"| {turning:.1f} | {100 * turning / 36:.0f} % |"
        )
        assert row in page


def arc(seconds):
    """The pose of a robot that drives 0.6 m/s and 0.9 rad/s from the origin."""
    turned = 0.9 * seconds
    return np.array([np.sin(turned), 1.0 - np.cos(turned), 1.5 * turned]) * (0.6 / 0.9)
