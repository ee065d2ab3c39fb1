import numpy as np
import pytest
from scipy import stats

from lndrl.config import LaserConfig
from lndrl.maps import OccupancyGrid, distance_field
from lndrl.maps.edges import ray_map
from lndrl.maps.raycast import clearance, raycast
from lndrl.randomness import stream_state
from lndrl.world.laser import Laser, add_noise, beam_bearings, make_fan

RESOLUTION = 0.1
NO_LEGS = np.zeros((0, 2))


def room(config=None):
    occupied = np.zeros((200, 200), dtype=bool)
    occupied[0] = occupied[-1] = True
    occupied[:, 0] = occupied[:, -1] = True
    occupied[120:130, 140:150] = True
    field = distance_field(occupied, RESOLUTION)
    grid = OccupancyGrid(occupied, RESOLUTION)
    rays = ray_map(grid, clearance(field, RESOLUTION))
    return Laser(config or LaserConfig(), rays), grid, field


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
        pose = np.array([9.013, 8.007, yaw])  # sees no corner dead on
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


def noisy(truth, n=200_000, seed=11, **weights):
    fan = make_fan(LaserConfig(**weights))
    ranges = np.full(n, truth, dtype=np.float32)
    out = np.empty_like(ranges)
    add_noise(ranges, fan, stream_state(seed), np.empty_like(ranges), out)
    return out


def categories(readings, truth, sigma=0.02):
    """How many readings are the maximum, near the truth, and spread below or above it."""
    at_maximum = readings == 12.0
    near = np.abs(readings - truth) < 6 * sigma
    below = ~near & (readings < truth)
    above = ~near & (readings > truth) & ~at_maximum
    return [int(part.sum()) for part in (at_maximum, near, below, above)]


@pytest.mark.parametrize(
    ("z_hit", "z_short", "z_max", "z_rand"),
    [
        (0.98, 0.0, 0.01, 0.01),
        (0.6, 0.15, 0.1, 0.15),
        (0.0, 0.0, 0.4, 0.6),
        (0.02, 0.49, 0.49, 0.0),
    ],
)
def test_noise_categories_have_their_frequencies(z_hit, z_short, z_max, z_rand):
    """Chi-square of 1,000,000 readings, refused at the 1 in 10,000 level."""
    truth, margin = 5.0, 6 * 0.02
    readings = noisy(truth, 1_000_000, z_hit=z_hit, z_short=z_short, z_max=z_max, z_rand=z_rand)
    short_near = (np.exp(-(truth - margin)) - np.exp(-truth)) / (1 - np.exp(-truth))
    shares = np.array(
        [
            z_max,
            z_hit + z_rand * 2 * margin / 12 + z_short * short_near,
            z_rand * (truth - margin) / 12 + z_short * (1 - short_near),
            z_rand * (12 - truth - margin) / 12,
        ]
    )
    counts = np.array(categories(readings, truth))
    assert (counts[shares == 0.0] == 0).all()
    expected = shares[shares > 0] * len(readings)
    assert stats.chisquare(counts[shares > 0], expected).pvalue > 1e-4


def test_other_readings_fall_on_all_beams_alike_and_independently():
    """Gaps between them are geometric, though drawn as gaps; 720 beams, chi-square at 1e-4."""
    fan = make_fan(LaserConfig(z_hit=0.9, z_max=0.1, z_rand=0.0))
    state = stream_state(3)
    ranges, normals = np.full(720, 5.0, np.float32), np.empty(720, np.float32)
    hits = np.empty((4000, 720), dtype=bool)
    out = np.empty(720, np.float32)
    for row in hits:
        add_noise(ranges, fan, state, normals, out)
        row[:] = out == 12.0
    assert stats.chisquare(hits.sum(axis=0)).pvalue > 1e-4
    both = (hits[:, 1:] & hits[:, :-1]).mean()
    assert both == pytest.approx(0.01, abs=5 * np.sqrt(0.01 / hits.size))
    per_scan = hits.sum(axis=1)
    assert per_scan.var() == pytest.approx(720 * 0.09, rel=5 * np.sqrt(2 / len(hits)))


def test_uniform_readings_are_uniform():
    readings = noisy(5.0, 400_000, z_hit=0.0, z_max=0.0, z_rand=1.0)
    assert stats.kstest(readings.astype(float) / 12.0, "uniform").pvalue > 1e-4


def test_beam_model_deviation_mean_and_shape():
    n = 1_000_000
    ranges = noisy(5.0, n, z_hit=1.0, z_max=0.0, z_rand=0.0, sigma_hit=0.02).astype(float)
    errors = (ranges - 5.0) / 0.02
    assert abs(errors.mean()) < 5 / np.sqrt(n)
    assert abs((errors**2).mean() - 1) < 5 * np.sqrt(2 / n)
    assert abs((errors**3).mean()) < 5 * np.sqrt(15 / n)
    assert abs((errors**4).mean() - 3) < 5 * np.sqrt(96 / n)
    assert abs(np.corrcoef(errors[:-1], errors[1:])[0, 1]) < 5 / np.sqrt(n)


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
    assert ranges.min() >= 0.0
    share = (1 - np.exp(-1.5 * ranges.astype(float))) / whole
    assert stats.kstest(share, "uniform").pvalue > 1e-4


def test_same_state_same_bits():
    laser, _, _ = room()
    pose = np.array([9.0, 8.0, 0.4])
    a = laser.scan(pose, NO_LEGS, 0.1, stream_state(5))
    b = laser.scan(pose, NO_LEGS, 0.1, stream_state(5))
    assert (a == b).all() and a.dtype == np.float32
    assert (a != laser.scan(pose, NO_LEGS, 0.1, stream_state(6))).any()
