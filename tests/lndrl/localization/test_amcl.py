"""The whole filter: tracking, gate, replay, recovery, bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.localization import AMCL, LikelihoodMap, PerfectLocalization, amcl_beam_stride
from lndrl.maps.grid import OccupancyGrid
from lndrl.randomness import stream_state

LASER = LaserConfig()
CONFIG = LocalizationConfig()
BEARINGS = np.linspace(-math.pi / 2, math.pi / 2, 720)[::12].astype(np.float32)
RESOLUTION = 0.1
START = np.array([4.0, 4.0, 0.0])
# A filter that soon has several clusters.
WILD = {"initial_deviation_xy": 2.0, "initial_deviation_yaw": 1.0}


def cluttered_grid():
    occupied = np.zeros((120, 160), dtype=bool)
    occupied[[0, -1]] = True
    occupied[:, [0, -1]] = True
    rng = np.random.default_rng(3)
    for _ in range(14):
        row, column = rng.integers(5, 105), rng.integers(5, 145)
        occupied[row : row + rng.integers(3, 12), column : column + rng.integers(3, 12)] = True
    occupied[30:90, 30:110] = False
    occupied[55:60, 65:75] = True
    return OccupancyGrid(occupied, RESOLUTION)


GRID = cluttered_grid()
FIELD = LikelihoodMap.build(GRID, CONFIG)


def brute_force_scan(pose, grid=GRID):
    """Ranges along the beams by sampling the grid every 2 cm; 12 m where nothing is met."""
    along = np.arange(0.02, 12.0, 0.02)
    angle = pose[2] + BEARINGS[:, None]
    column = ((pose[0] + np.cos(angle) * along) / RESOLUTION).astype(int)
    row = ((pose[1] + np.sin(angle) * along) / RESOLUTION).astype(int)
    height, width = grid.occupied.shape
    hit = grid.occupied[row.clip(0, height - 1), column.clip(0, width - 1)]
    return np.where(hit.any(axis=1), along[hit.argmax(axis=1)], 12.0).astype(np.float32)


def drive(seed, steps=150, deviation=0.1):
    """Truth, odometry and scans of a curved drive around the middle block."""
    rng = np.random.default_rng(seed)
    pose, odometry = START.copy(), np.zeros(3)
    log = []
    for i in range(steps):
        v, w = 0.5, 0.28 if i > 20 else 0.05
        factor_v, factor_w = rng.normal(1.0, deviation, 2)
        for state, dv, dw in ((pose, v, w), (odometry, v * factor_v, w * factor_w)):
            middle = state[2] + 0.05 * dw
            state += 0.1 * np.array([dv * math.cos(middle), dv * math.sin(middle), dw])
        scan = brute_force_scan(pose)
        scan += np.where(scan < 12.0, rng.normal(0.0, 0.02, scan.size), 0.0).astype(np.float32)
        log.append((pose.copy(), odometry.copy(), scan))
    return log


LOG = drive(0)


def started(seed=0, config=CONFIG, pose=START):
    amcl = AMCL(FIELD, config, LASER)
    amcl.reset(pose, stream_state(seed))
    return amcl


def angle_between(a, b):
    return abs(math.remainder(a - b, 2 * math.pi))


def test_stride_gives_the_papers_sixty_beams():
    assert amcl_beam_stride(LASER, CONFIG) == 12
    assert len(range(0, 720, 12)) == 60
    assert amcl_beam_stride(LASER, LocalizationConfig(laser_max_beams=1)) == 720
    assert amcl_beam_stride(LaserConfig(beams=30), CONFIG) == 1


def test_reset_draws_the_maximum_around_the_pose():
    amcl = started()
    assert amcl.count == 2000 and amcl.particles.shape == (2000, 3)
    assert amcl.particles.mean(axis=0) == pytest.approx(START, abs=0.01)
    assert np.sqrt(amcl.variance) == pytest.approx([0.05, 0.05, math.radians(3)], rel=0.1)
    assert amcl.pose_estimated == pytest.approx(START, abs=0.01)


def test_tracks_drives_with_slipping_wheels():
    squared, turns = [], []
    for seed in range(6):
        amcl = started(seed)
        for truth, odometry, scan in LOG if seed == 0 else drive(seed):
            assert amcl.update(odometry, scan, BEARINGS)
            squared.append(((amcl.pose_estimated[:2] - truth[:2]) ** 2).sum())
            turns.append(angle_between(amcl.pose_estimated[2], truth[2]))
        assert 500 <= amcl.count <= 2000
    # Dead reckoning reaches 0.2 m; the bound is a cell and a bit.
    assert math.sqrt(np.mean(squared)) < 0.12
    assert math.sqrt(np.mean(np.square(turns))) < 0.06


def test_scans_pull_a_wrong_start_to_the_truth():
    wide = LocalizationConfig(initial_deviation_xy=0.3)
    amcl = started(1, wide, np.add(START, [0.25, -0.2, 0.05]))
    for _, odometry, scan in LOG[:60]:
        amcl.update(odometry, scan, BEARINGS)
    assert np.hypot(*(amcl.pose_estimated - LOG[59][0])[:2]) < 0.12


def test_replay_is_bit_equal_and_seeds_differ():
    results = []
    for seed in (5, 5, 6):
        amcl = started(seed)
        for _, odometry, scan in LOG[:40]:
            amcl.update(odometry, scan, BEARINGS)
        results.append((amcl.particles.copy(), amcl.pose_estimated.copy(), amcl.covariance.copy()))
    for first, second in zip(results[0], results[1], strict=True):
        assert np.array_equal(first, second)
    assert not np.array_equal(results[0][1], results[2][1])


def test_a_reused_filter_starts_afresh():
    amcl = started(5)
    state = stream_state(5)
    outcomes = []
    for _ in range(2):
        amcl.reset(START, state)
        for _, odometry, scan in LOG[:20]:
            amcl.update(odometry, scan, BEARINGS)
        outcomes.append(amcl.particles.copy())
    assert np.array_equal(*outcomes)
    assert np.array_equal(state, stream_state(5))


def test_the_first_scan_counts_though_nothing_has_moved():
    """As in ROS: one update without motion, then the gate is closed to a robot that stands."""
    scan, still = brute_force_scan(START), np.zeros(3)
    for told in (True, False):
        amcl = started(config=LocalizationConfig(update_at_start=told, kld_one_bin="min"))
        drawn = amcl.particles.copy()
        assert amcl.update(still, scan, BEARINGS) == told
        assert not amcl.update(still, scan, BEARINGS)
        assert amcl.count == (501 if told else 2000)
        assert np.isin(amcl.particles[:, 0], drawn[:, 0]).all()  # nothing moved
        amcl.reset(START, stream_state(0))
        assert amcl.update(still, scan, BEARINGS) == told
        assert not amcl.update(np.array([math.nan, 0.0, 0.0]), scan, BEARINGS)


def test_closed_gate_changes_nothing():
    amcl = started()
    _, odometry, scan = LOG[0]
    assert amcl.update(odometry, scan, BEARINGS)
    before = amcl.particles.copy(), amcl.pose_estimated.copy(), amcl.variance.copy()
    # Each axis is tested alone: 0.0099 m on both is 0.014 m of way, and still standing.
    assert not amcl.update(np.add(odometry, [0.0099, -0.0099, 0.00099]), scan, BEARINGS)
    for old, new in zip(before, (amcl.particles, amcl.pose_estimated, amcl.variance), strict=True):
        assert np.array_equal(old, new)
    assert amcl.update(np.add(odometry, [0.0, 0.0, 0.0011]), scan, BEARINGS)
    # Small steps add up, because the gate compares with the last update.
    moved = np.add(odometry, [0.0, 0.0, 0.0011])
    assert not amcl.update(np.add(moved, [0.006, 0.0, 0.0]), scan, BEARINGS)
    assert amcl.update(np.add(moved, [0.012, 0.0, 0.0]), scan, BEARINGS)


def test_bad_odometry_and_readings_are_counted_and_survived():
    amcl = started()
    for i, (_, odometry, scan) in enumerate(LOG[:30]):
        if i % 5 == 0:
            for bad in (math.nan, math.inf, -math.inf, 1e300):
                assert not amcl.update(np.array([bad, 0.0, 0.0]), scan, BEARINGS)
                assert not amcl.update(np.array([0.0, 0.0, bad]), scan, BEARINGS)
        scan = scan.copy()
        scan[:3] = math.nan, math.inf, -math.inf
        assert amcl.update(odometry, scan, BEARINGS)
    assert amcl.ignored_odometry == 6 * 8
    assert amcl.ignored_readings == 30 * 3
    assert np.isfinite(amcl.particles).all() and np.isfinite(amcl.covariance).all()
    assert np.hypot(*(amcl.pose_estimated - LOG[29][0])[:2]) < 0.15
    blind = np.full(60, math.nan, dtype=np.float32)
    assert amcl.update(LOG[30][1], blind, BEARINGS)
    assert np.isfinite(amcl.pose_estimated).all()


def test_wrong_arguments_raise():
    amcl = started()
    scan = LOG[0][2]
    with pytest.raises(ValueError, match="one length"):
        amcl.update(np.zeros(3), scan[:5], BEARINGS)
    with pytest.raises(ValueError, match="three finite numbers"):
        amcl.reset([0.0, math.nan, 0.0], stream_state(1))
    with pytest.raises(ValueError, match="uint64"):
        amcl.reset(START, np.zeros(3, np.uint64))


def kidnap(seed, alpha_fast=0.5):
    """Converge, then put the robot elsewhere in a small map; greatest variance, final error."""
    config = LocalizationConfig(
        recovery_alpha_fast=alpha_fast, min_particles=2000, max_particles=4000
    )
    walls = np.ones((60, 80), dtype=bool)
    walls[5:55, 5:75] = False
    walls[5:20, 5:15] = walls[40:45, 30:60] = walls[15:22, 60:66] = True
    grid = OccupancyGrid(walls, RESOLUTION)
    amcl = AMCL(LikelihoodMap.build(grid, config), config, LASER)
    pose, odometry = np.array([2.0, 3.0, 0.0]), np.zeros(3)
    amcl.reset(pose, stream_state(seed))
    calm = wildest = 0.0
    for i in range(250):
        if i == 40:
            calm = amcl.variance[:2].sum()
            pose[:] = 5.2, 2.5, 2.0
        turn = 0.06 if i % 80 < 40 else -0.06
        pose[2] += turn
        odometry[2] += turn
        amcl.update(odometry, brute_force_scan(pose, grid), BEARINGS)
        if i > 40:
            wildest = max(wildest, amcl.variance[:2].sum())
    return calm, wildest, np.hypot(*(amcl.pose_estimated - pose)[:2])


def test_kidnapping_raises_the_variance_and_is_recovered_sometimes():
    outcomes = [kidnap(seed) for seed in range(6)]
    assert sum(wildest > max(0.2, 20 * calm) for calm, wildest, _ in outcomes) >= 4
    assert sum(error < 0.6 for _, _, error in outcomes) >= 2
    # Without injection the cloud stays where it was and stays sure of itself.
    _, wildest, error = kidnap(0, alpha_fast=0.0)
    assert wildest < 0.1 and error > 1.0


def test_looking_at_clusters_and_averages_changes_nothing():
    watched, left_alone = (
        started(7, LocalizationConfig(**WILD)),
        started(7, LocalizationConfig(**WILD)),
    )
    assert AMCL(FIELD, CONFIG, LASER).cluster_masses() == (0.0, 0.0)
    split = 0
    for _, odometry, scan in LOG:
        for amcl in (watched, left_alone):
            amcl.update(odometry, scan, BEARINGS)
        first, second = watched.cluster_masses()
        assert first == pytest.approx(left_alone.cluster_weight)
        assert 0.0 <= second <= first and first + second <= 1.0 + 1e-12
        split += second > 0.0
        for mine, theirs in zip(watched.snapshot(), left_alone.snapshot(), strict=True):
            np.testing.assert_array_equal(mine, theirs)
    assert split > 5
    np.testing.assert_array_equal(watched.averages, watched.snapshot().averages)


def test_resample_interval_keeps_weights_between():
    amcl = started(2, LocalizationConfig(resample_interval=3))
    counts = []
    for _, odometry, scan in LOG[:60]:
        amcl.update(odometry, scan, BEARINGS)
        counts.append(amcl.count)
    assert counts[:3] == [2000, 2000, counts[2]] and counts[2] < 2000
    assert np.hypot(*(amcl.pose_estimated - LOG[59][0])[:2]) < 0.15


def test_perfect_localization_says_the_truth():
    perfect = PerfectLocalization()
    perfect.reset(START, stream_state(0))
    perfect.set_truth([5.0, 4.0, 3 * math.pi / 2])
    assert perfect.update(np.zeros(3), LOG[0][2], BEARINGS)
    assert perfect.pose_estimated == pytest.approx([5.0, 4.0, -math.pi / 2])
    assert (perfect.variance == 0).all() and (perfect.covariance == 0).all()
    assert perfect.particles.shape == (1, 3) and perfect.count == 1
    with pytest.raises(ValueError, match="finite"):
        perfect.set_truth([0.0, math.inf, 0.0])
