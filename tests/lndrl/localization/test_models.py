"""The whole filter under every model: tracking, confidence, snapshots, many beliefs, presets."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

from lndrl.bench.wandering import record_drives, rectangles_scenario
from lndrl.config import LaserConfig, LocalizationConfig, WorldConfig
from lndrl.localization import (
    AMCL,
    Belief,
    LikelihoodMap,
    amcl_beam_stride,
    belief_of,
    kld_limits,
    make_beliefs,
    make_bins,
    make_field,
    make_scratch,
    make_settings,
    reset_belief,
    update_belief,
)
from lndrl.localization.confidence import effective_count
from lndrl.localization.motion import decompose, deviations
from lndrl.localization.recovery import injection_chance
from lndrl.localization.update import _predict, pack
from lndrl.randomness import stream_state
from lndrl.world import Place, beam_bearings
from tests.lndrl.localization.replayed import kidnapped, replay

WORLD = WorldConfig()
LASER = WORLD.laser
BEARINGS = beam_bearings(LASER)[::12].astype(np.float32)
BEST = LocalizationConfig.model_validate("best")


@pytest.fixture(scope="module")
def place():
    return Place.build(rectangles_scenario())


@pytest.fixture(scope="module")
def drives(place):
    return record_drives(place, WORLD, drives=10)


def config(**keys):
    return LocalizationConfig.model_validate(keys)


def make(place, settings, **arrays):
    return AMCL(LikelihoodMap.build(place.grid, settings), settings, LASER, **arrays)


def feed(amcl, drive, first, last):
    for i in range(first, last):
        assert amcl.update(drive.odometry[i], drive.ranges[i, ::12].copy(), BEARINGS)


def state_of(amcl):
    return amcl.particles.copy(), amcl.pose_estimated.copy(), amcl.covariance.copy()


def test_best_keeps_fifty_drives_on_track(place, drives):
    outcome = replay(drives, place.grid, BEST, LASER, seeds=5)
    assert outcome.lost == 0 and len(outcome.position_rmse) == 50
    assert outcome.position_rmse.mean() <= 0.012  # 0.0064 measured; beluga's best is 0.031
    assert outcome.position_error.max() < 0.15
    assert outcome.yaw_rmse.mean() < 0.002


def test_headings_wrap_at_the_cut(place, drives):
    """A drive that faces west and turns across the cut."""

    def crosses(drive):
        west = np.remainder(drive.truth[:, 2], 2 * math.pi)
        return west.min() < math.pi < west.max() and (np.abs(drive.truth[:, 2]) > 3.04).any()

    drive = next(filter(crosses, drives))
    for settings in (BEST, config(kld_one_bin="min")):
        outcome = replay([drive], place.grid, settings, LASER, seeds=2)
        assert outcome.yaw_error.max() < 0.15


def test_square_roots_and_true_edges_matter(place, drives):
    calm = {"kld_one_bin": "min"}
    ros = replay(drives, place.grid, config(), LASER, seeds=1)
    paper = replay(drives, place.grid, config(**calm), LASER, seeds=1)
    roots = {"odom_model_type": "diff-corrected", **calm}
    inside = replay(drives, place.grid, config(**roots), LASER, seeds=1)
    rim = replay(drives, place.grid, config(**roots, laser_field="boundaries"), LASER, seeds=3)
    edge = replay(drives, place.grid, config(**roots, laser_field="surfaces"), LASER, seeds=3)
    assert paper.position_rmse.mean() == pytest.approx(0.08, rel=0.35)
    # While one bin asks for the maximum the count flips and sets off the recovery: 0.19 measured.
    assert ros.position_rmse.mean() > 1.3 * paper.position_rmse.mean()
    assert edge.position_rmse.mean() < 0.95 * rim.position_rmse.mean()
    assert rim.position_rmse.mean() < 0.5 * inside.position_rmse.mean()
    assert rim.position_rmse.mean() < 0.07  # 0.051 here, 0.038 on other drives of the kind


def test_beam_model_tracks(place, drives):
    settings = config(laser_model_type="beam", min_particles=200, max_particles=300)
    short = drives[0]
    amcl = make(place, settings)
    amcl.reset(short.start, stream_state(1))
    feed(amcl, short, 0, 40)
    assert np.hypot(*(amcl.pose_estimated - short.truth[39])[:2]) < 0.12


def test_beam_skipping_forgives_objects_that_are_not_on_the_map(place, drives):
    """Every second beam ends 2 m away at the latest, on something that moves along."""
    errors = []
    for skip in (False, True):
        # Without random readings nothing else forgives.
        keys = {"laser_z_rand": 1e-6, "recovery_alpha_slow": 0, "recovery_alpha_fast": 0}
        amcl = make(place, config(preset="best", do_beamskip=skip, **keys))
        wrong = []
        for number, drive in enumerate(drives + drives):
            amcl.reset(drive.start, stream_state(number))
            for i in range(120):
                ranges = drive.ranges[i, ::12].copy()
                ranges[::2] = np.minimum(ranges[::2], 2.0)
                amcl.update(drive.odometry[i], ranges, BEARINGS)
                wrong.append(np.hypot(*(amcl.pose_estimated - drive.truth[i])[:2]))
        errors.append(np.mean(wrong))
    assert errors[1] < 0.95 * errors[0]  # 0.82 over 30 drives


def test_selective_resampling_waits_for_uneven_weights(place, drives):
    changes = []
    for selective in (False, True):
        amcl = make(place, config(selective_resampling=selective))
        amcl.reset(drives[0].start, stream_state(0))
        sizes, kept = [], []
        for i in range(20):
            feed(amcl, drives[0], i, i + 1)
            sizes.append(amcl.count)
            kept.append(amcl.effective_count)
        changes.append((sizes[0], min(kept)))
        assert all(1.0 <= n <= 2000.0 for n in kept)
    assert changes[0][0] < 2000
    # The paper's flat weights leave the first cloud as it is.
    assert changes[1][0] == 2000


def test_corrected_motion_has_textbook_moments():
    alpha = (0.2, 0.3, 0.4, 0.5)
    settings = config(
        odom_model_type="diff-corrected", min_particles=40_000, max_particles=40_000,
        **{f"odom_alpha{i + 1}": a for i, a in enumerate(alpha)},
    )  # fmt: skip
    belief = belief_of(make_beliefs(1, settings), 0)
    belief.random[:] = stream_state(2)
    particles = belief.particles[0]
    particles[:] = np.array([[3.0], [4.0], [0.5], [math.cos(0.5)], [math.sin(0.5)]])
    belief.odometry[:] = 1.0, 2.0, 0.5
    new = np.array([1.2, 2.1, 0.7])
    turn1, way, turn2 = decompose(belief.odometry, new)
    made = make_settings(settings, LASER)
    _predict(particles, 40_000, new, belief, make_scratch(settings, LASER), made)
    first = math.sqrt(0.2 * turn1**2 + 0.3 * way**2)
    forward = math.sqrt(0.4 * way**2 + 0.5 * (turn1**2 + turn2**2))
    second = math.sqrt(0.2 * turn2**2 + 0.3 * way**2)
    assert np.square([first, forward, second]) == pytest.approx(
        deviations(turn1, way, turn2, alpha)
    )
    turned = np.angle(np.exp(1j * (particles[2] - 0.5)))
    assert turned.std() == pytest.approx(math.hypot(first, second), rel=0.02)
    assert turned.mean() == pytest.approx(0.2, abs=5 * math.hypot(first, second) / 200)
    # A negative distance is a step backward: the signed length along the direction that was drawn.
    squared = (particles[0] - 3.0) ** 2 + (particles[1] - 4.0) ** 2
    assert squared.mean() == pytest.approx(way**2 + forward**2, rel=0.02)


def test_snapshot_restores_bit_for_bit(place, drives):
    amcl = make(place, BEST)
    amcl.reset(drives[0].start, stream_state(3))
    feed(amcl, drives[0], 0, 30)
    saved = amcl.snapshot()
    feed(amcl, drives[0], 30, 60)
    expected = state_of(amcl)
    # Into the same filter and into a fresh one, after something else has used its memory.
    other = make(place, BEST)
    other.reset(drives[1].start, stream_state(9))
    for each in (amcl, other):
        each.restore(saved)
        feed(each, drives[0], 30, 60)
        assert all(map(np.array_equal, state_of(each), expected))
    with pytest.raises(ValueError, match="2000 particles at most, this filter 600"):
        make(place, config(preset="best", max_particles=600)).restore(saved)


def test_filters_share_scratch_and_rows_of_one_belief(place, drives):
    beliefs = make_beliefs(2, BEST)
    scratch, bins = make_scratch(BEST, LASER), make_bins(BEST)
    shared = [
        make(place, BEST, belief=belief_of(beliefs, i), scratch=scratch, bins=bins)
        for i in range(2)
    ]
    alone = [make(place, BEST) for _ in range(2)]
    for filters in (shared, alone):
        for i, amcl in enumerate(filters):
            amcl.reset(drives[i].start, stream_state(i))
    for step in range(25):
        for filters in (shared, alone):
            for i, amcl in enumerate(filters):
                feed(amcl, drives[i], step, step + 1)
        _ = shared[0].cluster_weight  # on demand, in the shared memory
    for i in range(2):
        assert all(map(np.array_equal, state_of(shared[i]), state_of(alone[i])))
        assert np.array_equal(beliefs.pose[i], alone[i].pose_estimated)
    with pytest.raises(ValueError, match="exactly 500 particles"):
        small = config(preset="best", max_particles=500)
        make(place, small, belief=belief_of(beliefs, 0))
    with pytest.raises(ValueError, match="built for likelihood_field_prob, not likelihood_field"):
        AMCL(LikelihoodMap.build(place.grid, BEST), config(), LASER)


@njit
def _step_all(odometry, ranges, bearings, beliefs, scratch, bins, limits, field, settings):
    for world in range(odometry.shape[0]):
        belief = Belief(
            beliefs.particles[world], beliefs.weights[world], beliefs.averages[world],
            beliefs.odometry[world], beliefs.pose[world], beliefs.covariance[world],
            beliefs.numbers[world], beliefs.random[world], beliefs.quality[world],
            beliefs.alpha[world],
        )  # fmt: skip
        update_belief(
            odometry[world],
            ranges[world],
            bearings,
            belief,
            scratch,
            bins,
            limits,
            field,
            settings,
            True,
        )


def test_what_is_not_published_at_once_is_published_later(place, drives):
    """Also when the robot then stands still, so that no update comes of the call."""
    drive, settings = drives[0], config()
    amcl = make(place, settings)
    amcl.reset(drive.start, stream_state(3))
    feed(amcl, drive, 0, 4)
    quiet = belief_of(make_beliefs(1, settings), 0)
    scratch, bins = make_scratch(settings, LASER), make_bins(settings)
    table = make_field(LikelihoodMap.build(place.grid, settings))
    rest = (scratch, bins, kld_limits(settings), table, make_settings(settings, LASER))
    quiet.random[:] = stream_state(3)
    reset_belief(drive.start, np.array(settings.initial_deviations), quiet, scratch, bins)
    start = quiet.pose.copy()
    for i in range(4):
        update_belief(
            drive.odometry[i], drive.ranges[i, ::12].copy(), BEARINGS, quiet, *rest, False
        )
    assert (quiet.pose == start).all()
    still = (drive.odometry[3], drive.ranges[3, ::12].copy(), BEARINGS)
    assert not update_belief(*still, quiet, *rest, True)
    assert quiet.pose == pytest.approx(amcl.pose_estimated, abs=1e-12)
    assert quiet.covariance == pytest.approx(amcl.covariance, abs=1e-12)


def test_kernels_serve_many_worlds_in_one_call(place, drives):
    beliefs = make_beliefs(3, BEST)
    scratch, bins = make_scratch(BEST, LASER), make_bins(BEST)
    table = LikelihoodMap.build(place.grid, BEST)
    constant = (kld_limits(BEST), make_field(table), make_settings(BEST, LASER))
    spread = np.array(BEST.initial_deviations)
    alone = [make(place, BEST) for _ in range(3)]
    for i in range(3):
        belief = belief_of(beliefs, i)
        belief.random[:] = stream_state(i)
        reset_belief(drives[i].start, spread, belief, scratch, bins)
        alone[i].reset(drives[i].start, stream_state(i))
    for step in range(10):
        odometry = np.array([drives[i].odometry[step] for i in range(3)])
        ranges = np.array([drives[i].ranges[step, ::12] for i in range(3)])
        _step_all(odometry, ranges, BEARINGS, beliefs, scratch, bins, *constant)
        for i in range(3):
            feed(alone[i], drives[i], step, step + 1)
    for i in range(3):
        assert np.array_equal(beliefs.pose[i], alone[i].pose_estimated)
        assert np.array_equal(beliefs.weights[i], alone[i].snapshot().weights)


def test_confidence_of_a_good_and_of_a_lost_filter(place, drives):
    amcl = make(place, config(preset="best", recovery_alpha_slow=0, recovery_alpha_fast=0))
    amcl.reset(drives[0].start, stream_state(0))
    assert amcl.effective_count == 2000 and amcl.beam_agreement == 0.0
    feed(amcl, drives[0], 0, 40)
    assert amcl.beam_agreement > 0.9
    assert 1 <= amcl.effective_count < 500
    assert amcl.cluster_weight == pytest.approx(1.0)
    assert amcl.cluster_covariance == pytest.approx(amcl.covariance, abs=1e-9)
    amcl.reset(drives[1].start, stream_state(0))
    feed(amcl, drives[0], 0, 20)
    assert amcl.beam_agreement < 0.5


@pytest.mark.parametrize("count", [1, 3, 4, 501])
def test_effective_count_is_the_inverse_square_sum(count):
    weights = np.random.default_rng(count).exponential(1.0, count + 5)
    weights[:count] /= weights[:count].sum()
    expected = 1.0 / np.square(weights[:count]).sum()
    assert effective_count(weights, count) == pytest.approx(expected)


def test_cluster_covariance_leaves_the_rest_out(place):
    amcl = make(place, config(max_particles=2000))
    amcl.reset([5.0, 5.0, 1.0], stream_state(0))
    particles = amcl._belief.particles[0]
    particles[0, :300] = 20.0
    particles[2, :300] = -2.0
    particles[3, :300], particles[4, :300] = math.cos(-2.0), math.sin(-2.0)
    weights = amcl._belief.weights
    weights[:300], weights[300:] = 0.25 / 300, 0.75 / 1700
    covariance = amcl.cluster_covariance
    cloud = amcl.particles[300:]
    assert amcl.cluster_weight == pytest.approx(0.75)
    assert covariance[:2, :2] == pytest.approx(np.cov(cloud[:, :2].T, bias=True), rel=1e-6)
    assert covariance[2, 2] == pytest.approx(cloud[:, 2].var(), rel=0.01)
    assert covariance[0, 2] == covariance[1, 2] == 0.0


def test_start_covariance(place):
    amcl = make(place, config(initial_cov_xx=0.25, initial_cov_aa=0.04))
    amcl.reset([5.0, 5.0, 1.0], stream_state(0))
    assert np.sqrt(amcl.variance) == pytest.approx([0.5, 0.05, 0.2], rel=0.1)
    asked = np.array([[0.04, 0.03, 0.0], [0.03, 0.09, 0.0], [0.0, 0.0, 0.01]])
    amcl.reset([5.0, 5.0, 1.0], stream_state(0), covariance=asked)
    assert amcl.covariance == pytest.approx(asked, abs=0.006)
    assert amcl.particles.mean(axis=0) == pytest.approx([5, 5, 1], abs=0.03)
    for wrong in (np.eye(2), -np.eye(3), np.full((3, 3), np.nan), np.triu(np.ones((3, 3)))):
        with pytest.raises(ValueError, match="covariance must"):
            amcl.reset([5.0, 5.0, 1.0], stream_state(0), covariance=wrong)


def test_global_localization_is_uniform_and_finds_robots(place, drives):
    # Thirty particles per square metre: only flat weights let the nearest ones survive.
    keys = {"laser_sigma_hit": 0.2, "laser_likelihood_exponent": 0.1}
    amcl = make(place, config(preset="best", max_particles=20_000, **keys))
    with pytest.raises(ValueError, match="never reset"):
        amcl.global_localization()
    found = 0
    for number, drive in enumerate(drives + drives):
        amcl.global_localization(stream_state(number), pose_odometry=[0.0, 0.0, 0.0])
        if number == 0:
            x, y, yaw = amcl.particles.T
            assert np.histogram(x, 5, (0.1, 32.9))[0] == pytest.approx(4000, rel=0.15)
            assert np.histogram(yaw, 4, (-math.pi, math.pi))[0] == pytest.approx(5000, rel=0.06)
            assert amcl.count == 20_000 and amcl.effective_count == 20_000
            cells = [place.grid.index(a, b) for a, b in zip(x, y, strict=True)]
            assert not any(place.grid.occupied[cell] for cell in cells)
        feed(amcl, drive, 0, 80)
        found += np.hypot(*(amcl.pose_estimated - drive.truth[79])[:2]) < 0.3
    assert found >= 5  # of 20, 14 of 30 measured; the room looks alike in many places


def test_kidnapped_robots_are_found_again_and_only_with_recovery(place, drives):
    logs = [kidnapped(drives[i], drives[(i + 3) % 10]) for i in range(5)]
    back = []
    for skip in (True, False):
        settings = config(preset="best", do_beamskip=skip)
        outcome = replay(logs, place.grid, settings, LASER, seeds=2)
        assert outcome.position_error[:, :200].max() < 0.2
        back.append((outcome.position_error[:, -20:].max(axis=1) < 0.3).mean())
    # 0.3 and 0.8 measured, within 20 s and with 2000 particles at most: skipping beams keeps
    # crowds from setting off the recovery, and hides a part of what should.
    assert back[0] >= 0.1 and back[1] >= 0.5
    without = config(preset="best", recovery_alpha_slow=0, recovery_alpha_fast=0)
    stays = replay(logs[:2], place.grid, without, LASER, seeds=1)
    assert (stays.position_error[:, -20:].min(axis=1) > 0.5).all()


def test_persistent_recovery_lasts_and_tolerates():
    averages = np.array([0.8, 0.3])
    assert injection_chance(averages, 2.0, 1) == pytest.approx(1 - 2 * 0.3 / 0.8)
    assert averages.tolist() == [0.8, 0.3]
    assert injection_chance(averages, 3.0, 1) == 0.0
    assert injection_chance(np.zeros(2), 1.0, 1) == 0.0
    assert injection_chance(averages, 3.0, 0) == pytest.approx(1 - 0.3 / 0.8)
    assert averages.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("model", ["likelihood_field", "likelihood_field_prob", "beam"])
def test_no_input_breaks_any_model(place, drives, model):
    settings = config(laser_model_type=model, laser_sigma_hit=0.001, laser_z_rand=0.0,
                      laser_z_short=0.0, laser_z_max=0.0, min_particles=50,
                      max_particles=100)  # fmt: skip
    amcl = make(place, settings)
    amcl.reset([-500.0, 3.0, 0.0], stream_state(0))  # off the map, nothing fits
    drive = drives[0]
    for i in range(12):
        ranges = drive.ranges[i, ::12].copy()
        ranges[: 5 * i] = [math.nan, math.inf, -math.inf, -1.0, 1e30][i % 5]
        assert amcl.update(drive.odometry[i], ranges, BEARINGS)
        assert not amcl.update(np.full(3, math.nan), ranges, BEARINGS)
        assert np.isfinite(amcl.particles).all() and np.isfinite(amcl.covariance).all()
        assert np.isfinite(amcl.pose_estimated).all()
        assert 0.0 <= amcl.beam_agreement <= 1.0 and amcl.effective_count >= 0.999
        assert amcl._belief.weights[: amcl.count].sum() == pytest.approx(1.0)
    assert amcl.ignored_odometry == 12 and amcl.ignored_readings > 0


def test_one_signature_serves_every_model(place):
    """Compilation is the price of a signature: none of the settings may add one."""
    kinds = {
        str(tuple(map(type, pack(make_settings(each, LASER))[0])))
        for each in (config(), BEST, config(laser_model_type="beam", selective_resampling=True))
    }
    assert len(kinds) == 1
    assert amcl_beam_stride(LaserConfig(), config(laser_max_beams=100)) == 7
