import numpy as np
import pytest

from lndrl.config import LaserConfig
from lndrl.maps import OccupancyGrid, clearance, distance_field, raycast
from lndrl.randomness import stream_state
from lndrl.world.laser import Laser, add_noise, beam_bearings

RESOLUTION = 0.1
NO_LEGS = np.zeros((0, 2))


def room(config=None):
    occupied = np.zeros((200, 200), dtype=bool)
    occupied[0] = occupied[-1] = True
    occupied[:, 0] = occupied[:, -1] = True
    occupied[120:130, 140:150] = True
    field = distance_field(occupied, RESOLUTION)
    laser = Laser(config or LaserConfig(), clearance(field, RESOLUTION), RESOLUTION)
    return laser, OccupancyGrid(occupied, RESOLUTION), field


def circle_range(bearing, x, y, radius):
    """Smallest t >= 0 with |t d - c| = r by the quadratic formula, in the robot frame."""
    b = np.cos(bearing) * x + np.sin(bearing) * y
    root = b * b - (x * x + y * y - radius * radius)
    return b - np.sqrt(root) if root >= 0 and b > 0 else np.inf


def test_bearings_start_at_minus_half_the_view_and_increase():
    bearings = beam_bearings(LaserConfig())
    assert len(bearings) == 720
    assert bearings[0] == -np.pi / 2
    assert bearings[360] == pytest.approx(0.0)
    assert np.diff(bearings) == pytest.approx(np.pi / 720)


def test_walls_are_those_of_the_plain_raycast():
    laser, grid, field = room()
    for yaw in (-3.0, 0.0, 0.5, 2.0):
        pose = np.array([9.0, 8.0, yaw])
        got = laser.true_ranges(pose, NO_LEGS, 0.1)
        assert got == pytest.approx(raycast(grid, field, pose, laser.bearings, 12.0), abs=1e-4)


@pytest.mark.parametrize("view", [np.pi, 2 * np.pi])
def test_legs_are_discs_exactly(view):
    laser, _, _ = room(LaserConfig(field_of_view=view))
    rng = np.random.default_rng(4)
    for _ in range(40):
        pose = np.array([10.0, 10.0, rng.uniform(-np.pi, np.pi)])
        angle = rng.uniform(-np.pi, np.pi, 6)
        legs = pose[:2] + rng.uniform(0.15, 9.0, 6)[:, None] * np.stack(
            [np.cos(angle), np.sin(angle)], axis=1
        )
        want = laser.true_ranges(pose, NO_LEGS, 0.1).astype(float)
        c, s = np.cos(pose[2]), np.sin(pose[2])
        for dx, dy in legs - pose[:2]:
            x, y = c * dx + s * dy, c * dy - s * dx
            ranges = [circle_range(b, x, y, 0.1) for b in laser.bearings]
            want = np.minimum(want, ranges)
        assert laser.true_ranges(pose, legs, 0.1) == pytest.approx(want, abs=1e-4)


def test_a_leg_straight_behind_is_seen_by_a_full_circle_only():
    legs = np.array([[9.0, 10.0]])
    pose = np.array([10.0, 10.0, 0.0])
    half, _, _ = room()
    full, _, _ = room(LaserConfig(field_of_view=2 * np.pi))
    assert half.true_ranges(pose, legs, 0.1).min() > 2.0
    seen = full.true_ranges(pose, legs, 0.1)
    assert seen[0] == pytest.approx(0.9) and seen[-1] == pytest.approx(0.9, abs=0.01)


def test_stride_picks_every_nth_beam():
    laser, _, _ = room()
    pose = np.array([9.0, 8.0, 0.4])
    legs = np.array([[10.0, 8.5], [8.7, 9.0]])
    full = laser.true_ranges(pose, legs, 0.1)
    assert (laser.true_ranges(pose, legs, 0.1, stride=12) == full[::12]).all()
    assert (laser.true_ranges(pose, legs, 0.1, stride=7) == full[::7]).all()


def test_a_leg_around_the_laser_blinds_it():
    laser, _, _ = room()
    legs = np.array([[9.05, 8.0]])
    assert (laser.true_ranges(np.array([9.0, 8.0, 0.0]), legs, 0.1) == 0.0).all()


def noisy(truth, n=200_000, **weights):
    config = LaserConfig(**weights)
    laser = Laser(config, np.ones((2, 2), np.uint8), 1.0)
    ranges = np.full(n, truth, dtype=np.float32)
    add_noise(ranges, config.range_max, laser._noise, stream_state(11))
    return ranges


def test_beam_model_frequencies():
    ranges = noisy(5.0, z_hit=0.7, z_max=0.1, z_rand=0.2)
    n = len(ranges)
    assert (ranges == 12.0).mean() == pytest.approx(0.1, abs=4 * np.sqrt(0.1 * 0.9 / n))
    near = np.abs(ranges - 5.0) < 0.12
    assert near.mean() == pytest.approx(0.7 + 0.2 * 0.24 / 12, abs=0.005)
    spread = ranges[~near & (ranges < 12.0)]
    counts, _ = np.histogram(spread, bins=10, range=(0.0, 12.0))
    expected = np.full(10, 0.2 * n * 1.2 / 12)
    expected[4] -= 0.2 * n * 0.24 / 12  # 4.88 .. 5.12, around the truth, was taken out
    chi2 = ((counts - expected) ** 2 / expected).sum()
    assert chi2 < 30  # 10 bins: 99.9 % below 29.6


def test_beam_model_deviation_and_mean():
    ranges = noisy(5.0, z_hit=1.0, z_max=0.0, z_rand=0.0, sigma_hit=0.02)
    assert ranges.mean() == pytest.approx(5.0, abs=3e-4)
    assert ranges.std() == pytest.approx(0.02, rel=0.01)


def test_no_echo_stays_at_the_maximum_and_readings_stay_in_range():
    ranges = noisy(12.0, z_hit=1.0, z_max=0.0, z_rand=0.0)
    assert (ranges == 12.0).all()
    for truth in (0.0, 11.999):
        ranges = noisy(truth, z_hit=0.9, z_max=0.05, z_rand=0.05, sigma_hit=0.5)
        assert ranges.min() >= 0.0 and ranges.max() <= 12.0


def test_short_readings_fall_off_exponentially_before_the_truth():
    ranges = noisy(2.0, z_hit=0.0, z_short=1.0, z_max=0.0, z_rand=0.0, lambda_short=1.5)
    assert ranges.max() <= 2.0
    whole = 1 - np.exp(-3.0)
    mean = (1 / 1.5) - 2.0 * np.exp(-3.0) / whole
    assert ranges.mean() == pytest.approx(mean, abs=0.01)


def test_same_state_same_bits():
    laser, _, _ = room()
    pose = np.array([9.0, 8.0, 0.4])
    a = laser.scan(pose, NO_LEGS, 0.1, stream_state(5))
    b = laser.scan(pose, NO_LEGS, 0.1, stream_state(5))
    assert (a == b).all() and a.dtype == np.float32
    assert (a != laser.scan(pose, NO_LEGS, 0.1, stream_state(6))).any()
