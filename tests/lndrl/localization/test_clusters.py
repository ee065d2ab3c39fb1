"""Pose of the heaviest cluster and covariance of the whole set against NumPy and SciPy twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lndrl.config import LocalizationConfig
from lndrl.localization.bins import bin_keys, insert, make_bins
from lndrl.localization.clusters import estimate, two_heaviest

CONFIG = LocalizationConfig(min_particles=1, max_particles=3000)


def binned(poses):
    count = len(poses)
    yaw = poses[:, 2]
    rows = np.array([*poses.T, np.cos(yaw), np.sin(yaw)])
    bins = make_bins(CONFIG)
    keys, bin_of = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int32)
    bin_keys(rows, count, bins, keys)
    k = 0
    for i in range(count):
        bin_of[i], k = insert(keys[i], bins, k)
    return rows, bin_of, bins, k


def kernel(poses, weights):
    rows, bin_of, bins, k = binned(poses)
    pose, covariance = np.zeros(3), np.full((3, 3), np.nan)
    estimate(rows, weights, len(poses), bin_of, bins, k, pose, covariance)
    return pose, covariance


def masses(poses, weights):
    _, bin_of, bins, k = binned(poses)
    found = np.full(2, np.nan)
    two_heaviest(weights, len(poses), bin_of, bins, k, found)
    return found


def clusters_of(poses):
    """Indices of every cluster's members: flood fill over occupied bins in a dictionary."""
    members: dict[tuple[int, int, int], list[int]] = {}
    for i, (x, y, yaw) in enumerate(poses):
        turn = int((yaw + math.pi) // math.radians(10.0))
        members.setdefault((math.floor(x / 0.5), math.floor(y / 0.5), min(turn, 35)), []).append(i)
    found: list[list[int]] = []
    open_bins = set(members)
    while open_bins:
        stack, cluster = [open_bins.pop()], []
        while stack:
            column, row, turn = stack.pop()
            cluster += members[column, row, turn]
            for dx in (-1, 0, 1):
                for dy in (-1, 0, 1):
                    for da in (-1, 0, 1):
                        other = (column + dx, row + dy, (turn + da) % 36)
                        if other in open_bins:
                            open_bins.remove(other)
                            stack.append(other)
        found.append(cluster)
    return found


def twin(poses, weights):
    """Plain formulas over the heaviest cluster and over all."""
    best = max(clusters_of(poses), key=lambda cluster: weights[cluster].sum())
    w = weights[best] / weights[best].sum()
    direction = (w * np.exp(1j * poses[best, 2])).sum()
    pose = np.array([*(w @ poses[best, :2]), np.angle(direction)])
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = np.cov(poses[:, :2].T, aweights=weights, ddof=0)
    whole = abs((weights / weights.sum() * np.exp(1j * poses[:, 2])).sum())
    covariance[2, 2] = -2 * math.log(whole)
    return pose, covariance


def scattered(seed):
    """Six clouds, some of which touch, and uneven weights."""
    rng = np.random.default_rng(seed)
    blobs = [
        np.column_stack(
            [
                rng.normal(rng.uniform(-6, 20), rng.uniform(0.05, 0.5), n),
                rng.normal(rng.uniform(-6, 20), rng.uniform(0.05, 0.5), n),
                rng.normal(rng.uniform(-4, 4), rng.uniform(0.02, 0.5), n),
            ]
        )
        for n in rng.integers(20, 400, 6)
    ]
    poses = np.vstack(blobs)
    poses[:, 2] = (poses[:, 2] + math.pi) % (2 * math.pi) - math.pi
    return poses, rng.uniform(0.5, 1.5, len(poses))


@pytest.mark.parametrize("seed", range(12))
def test_masses_of_the_two_heaviest_clusters_match_their_twin(seed):
    poses, weights = scattered(seed)
    sums = sorted((weights[cluster].sum() for cluster in clusters_of(poses)), reverse=True)
    expected = np.array([*sums, 0.0])[:2] / weights.sum()
    assert masses(poses, weights) == pytest.approx(expected, abs=1e-12)


def test_masses_where_there_is_one_cluster_or_none():
    assert masses(np.zeros((5, 3)), np.full(5, 0.2)) == pytest.approx([1.0, 0.0])
    touching = np.array([[0.4, 0.0, 0.0], [0.6, 0.0, 0.0], [0.6, 0.0, 0.0], [9.0, 0.0, 0.0]])
    assert masses(touching[:3], np.ones(3)) == pytest.approx([1.0, 0.0])
    assert masses(touching, np.ones(4)) == pytest.approx([0.75, 0.25])
    assert masses(np.zeros((5, 3)), np.zeros(5)) == pytest.approx([0.0, 0.0])
    assert masses(np.zeros((0, 3)), np.zeros(0)) == pytest.approx([0.0, 0.0])


def test_masses_never_leave_their_arrays():
    poses, weights = scattered(0)
    _, bin_of, bins, k = binned(poses)
    bin_of[::3], bin_of[1::3] = -1, 2**31 - 1
    found = np.zeros(2)
    two_heaviest(weights, len(poses) + 100, bin_of, bins, k + 10_000, found)
    assert 0.0 <= found[1] <= found[0] <= 1.0


@pytest.mark.parametrize("seed", range(12))
def test_matches_twin_on_scattered_clouds(seed):
    poses, weights = scattered(seed)
    pose, covariance = kernel(poses, weights)
    expected_pose, expected_covariance = twin(poses, weights)
    assert pose == pytest.approx(expected_pose, abs=1e-9)
    assert covariance == pytest.approx(expected_covariance, abs=1e-9)


def test_two_clusters_give_the_heavier_pose_and_the_whole_variance():
    rng = np.random.default_rng(1)
    heavy = rng.normal([2.0, 3.0, 0.5], 0.02, (300, 3))
    light = rng.normal([12.0, 3.0, 0.5], 0.02, (200, 3))
    poses = np.vstack([light, heavy])
    pose, covariance = kernel(poses, np.full(500, 1 / 500))
    assert pose == pytest.approx([2.0, 3.0, 0.5], abs=0.01)
    assert covariance[0, 0] == pytest.approx(0.6 * 0.4 * 100.0, rel=0.01)
    assert covariance[1, 1] == pytest.approx(4e-4, rel=0.2)
    # Weight decides, not the number of particles.
    weights = np.r_[np.full(200, 0.004), np.full(300, 0.2 / 300)]
    assert kernel(poses, weights)[0] == pytest.approx([12.0, 3.0, 0.5], abs=0.01)


def test_heading_wraps_at_pi():
    rng = np.random.default_rng(2)
    yaw = math.pi + rng.normal(0, 0.1, 400)
    west = np.column_stack([np.full((400, 2), 1.2), (yaw + math.pi) % (2 * math.pi) - math.pi])
    rival = np.tile([8.2, 8.2, 0.0], (300, 1))
    # Cut at pi, the western cloud would be two clusters of 200 and lose to the rival.
    pose, _ = kernel(np.vstack([west, rival]), np.full(700, 1 / 700))
    assert pose[:2] == pytest.approx([1.2, 1.2])
    assert abs(abs(pose[2]) - math.pi) < 0.03
    _, covariance = kernel(west, np.full(400, 1 / 400))
    assert covariance[2, 2] == pytest.approx(0.01, rel=0.2)


@pytest.mark.parametrize("step", [(0.5, 0.0), (0.0, 0.5), (0.5, 0.5), (0.5, -0.5)])
@pytest.mark.parametrize("turn", [-0.05, 0.0, 0.05])
def test_bins_touch_across_corners_and_the_cut(step, turn):
    first = np.tile([1.2, 1.2, -math.pi + 0.1], (200, 1))
    second = np.tile([1.2 + step[0], 1.2 + step[1], math.pi - 0.1], (200, 1))
    if turn:
        first[:, 2], second[:, 2] = turn, -turn  # bins 17 and 18: no cut between them
    rival = np.tile([8.2, 8.2, 0.0], (300, 1))
    for order in ([first, second, rival], [rival, second, first]):
        pose, _ = kernel(np.vstack(order), np.full(700, 1 / 700))
        assert pose[:2] == pytest.approx([1.2 + step[0] / 2, 1.2 + step[1] / 2])


def test_variance_far_from_the_origin_and_of_opposite_headings():
    poses = np.array([[1e5, 1e5, -1.5], [1e5 + 0.002, 1e5, 1.6]])
    _, covariance = kernel(poses, np.full(2, 0.5))
    assert covariance[0, 0] == pytest.approx(1e-6, rel=1e-3)
    opposite = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -math.pi]])
    assert np.isfinite(kernel(opposite, np.full(2, 0.5))[1]).all()
