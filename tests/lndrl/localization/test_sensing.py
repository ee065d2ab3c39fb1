"""The filter behind a real scanner: mounts, thinning, minimum range, stamps, silence."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.localization import (
    AMCL,
    Heard,
    LikelihoodMap,
    Scanner,
    SensorFilter,
    beam_stride,
    compose,
)
from lndrl.maps.grid import OccupancyGrid
from lndrl.randomness import stream_state

CONFIG = LocalizationConfig(preset="robot", min_particles=300, max_particles=600)
RESOLUTION = 0.05


def room() -> OccupancyGrid:
    """8 m x 6 m of walls with a few things in it, no symmetry."""
    occupied = np.zeros((120, 160), dtype=bool)
    occupied[:2] = occupied[-2:] = True
    occupied[:, :2] = occupied[:, -2:] = True
    occupied[20:40, 30:40] = occupied[80:90, 60:100] = occupied[50:55, 120:150] = True
    return OccupancyGrid(occupied, RESOLUTION)


GRID = room()
START = np.array([3.0, 3.0, 0.4])


def scan(pose: np.ndarray, scanner: Scanner, count: int, minimum: float = -math.pi) -> np.ndarray:
    """Ranges (count,) m of a full turn from ``minimum`` on, for a base at ``pose``."""
    increment = 2.0 * math.pi / count
    bearings = scanner.bearings(minimum, increment, count).astype(float)
    place = compose(pose, [scanner.x, scanner.y, 0.0])
    along = np.arange(0.01, 12.0, 0.01)
    angle = pose[2] + bearings[:, None]
    column = ((place[0] + np.cos(angle) * along) / RESOLUTION).astype(int).clip(0, 159)
    row = ((place[1] + np.sin(angle) * along) / RESOLUTION).astype(int).clip(0, 119)
    return along[GRID.occupied[row, column].argmax(axis=1)].astype(np.float32)


def drive(scanner: Scanner, count: int = 90, told: Scanner | None = None, steps: int = 20):
    """The filter and the truth after a curve; ``told``: where it is told that the scanner is."""
    made = SensorFilter(GRID, CONFIG, told or scanner)
    made.reset(START, stream_state(1), [0.0, 0.0, 0.0])
    truth, odometry = START.copy(), np.zeros(3)
    made.add_odometry(0.0, odometry)
    for k in range(1, steps + 1):
        move = [0.05, 0.0, 0.08 if k % 20 < 10 else -0.08]
        truth, odometry = compose(truth, move), compose(odometry, move)
        made.add_odometry(0.1 * k, odometry)
        ranges = scan(truth, scanner, count)
        assert made.add_scan(0.1 * k, ranges, -math.pi, 2 * math.pi / count) == Heard.UPDATED
    return made, truth


def read(made: SensorFilter, stamp: float) -> np.ndarray:
    pose = made.odometer.at(stamp)
    assert pose is not None
    return pose


def off(made: SensorFilter, truth: np.ndarray) -> float:
    return float(np.hypot(*(made.pose() - truth)[:2]))


@pytest.mark.parametrize(
    "scanner",
    [
        Scanner(x=0.25, y=-0.1, yaw=0.7),
        Scanner(x=-0.2, yaw=math.pi, upside_down=True),
    ],
)
def test_a_scanner_off_the_centre_is_where_it_is_told(scanner: Scanner) -> None:
    made, truth = drive(scanner)
    assert off(made, truth) < 0.04
    # As a control: a filter that takes it for one at the centre is off by as much as it is.
    wrong, truth = drive(scanner, told=Scanner(yaw=scanner.yaw, upside_down=scanner.upside_down))
    assert off(wrong, truth) > 0.08


@pytest.mark.parametrize("count", [40, 361, 1600])
def test_any_number_of_beams(count: int) -> None:
    made, truth = drive(Scanner(), count, steps=12)
    assert off(made, truth) < 0.04


def test_thinning_happens_once() -> None:
    for beams in (1, 2, 59, 60, 61, 119, 720, 1601):
        for most in (1, 2, 30, 60):
            stride = beam_stride(beams, most)
            used = len(range(0, beams, stride))
            assert used <= max(1, 2 * (most - 1)) or used == beams
            assert beam_stride(used, most) == 1 or most == 1
    laser = LaserConfig(beams=720)
    field = LikelihoodMap.build(GRID, CONFIG, laser)
    every, thinned = AMCL(field, CONFIG, laser), AMCL(field, CONFIG, laser)
    ranges = scan(START, Scanner(), 720)
    bearings = Scanner().bearings(-math.pi, 2 * math.pi / 720, 720)
    for amcl, step in ((every, 1), (thinned, 12)):
        amcl.reset(START, stream_state(3))
        assert amcl.update(np.array([0.1, 0.0, 0.0]), ranges[::step], bearings[::step])
    np.testing.assert_array_equal(every.particles, thinned.particles)


def test_readings_at_the_minimum_are_no_echo() -> None:
    """Zeros that a driver writes for no echo must not cost the pose."""
    outcomes = []
    for scanner in (Scanner(range_min=0.12), Scanner()):
        made = SensorFilter(GRID, CONFIG, scanner)
        made.reset(START, stream_state(1), np.zeros(3))
        made.add_odometry(0.0, np.zeros(3))
        truth = START.copy()
        for k in range(1, 16):
            truth = compose(truth, [0.05, 0.0, 0.05])
            odometry = compose(read(made, 0.1 * (k - 1)), [0.05, 0.0, 0.05])
            made.add_odometry(0.1 * k, odometry)
            ranges = scan(truth, scanner, 360)
            ranges[np.arange(360) % 4 < 2] = 0.0  # of the beams that are used, too
            made.add_scan(0.1 * k, ranges, -math.pi, 2 * math.pi / 360)
        outcomes.append((off(made, truth), made.health(1.5).agreement))
    (right, agreed), (_, doubted) = outcomes
    assert right < 0.04 and agreed > 0.95 and doubted < 0.7


def test_the_configured_minimum_counts_too() -> None:
    assert LocalizationConfig().min_range(-1.0) < 0.0
    assert LocalizationConfig(laser_min_range=0.3).min_range(0.1) == 0.3
    assert LocalizationConfig(laser_min_range=0.3).min_range(0.5) == 0.5
    with pytest.raises(ValueError, match="above 0, or -1"):
        LocalizationConfig(laser_min_range=-0.5)


def test_scans_take_the_odometer_of_their_time() -> None:
    """While it turns on the spot, a scan that is 0.1 s old is 0.09 rad off."""
    made = SensorFilter(GRID, CONFIG, Scanner())
    made.reset(START, stream_state(1), np.zeros(3))
    made.add_odometry(0.0, np.zeros(3))
    for k in range(1, 30):
        now = 0.1 * k
        made.add_odometry(now, [0.0, 0.0, 0.9 * now])
        then = now - 0.07  # when the scan was taken
        truth = np.add(START, [0.0, 0.0, 0.9 * then])
        assert made.add_scan(then, scan(truth, Scanner(), 180), -math.pi, math.pi / 90)
        assert made.pose(then)[2] == pytest.approx(math.remainder(truth[2], math.tau), abs=0.03)
        newest = math.remainder(START[2] + 0.9 * now, math.tau)
        assert abs(math.remainder(made.pose()[2] - newest, math.tau)) < 0.03


def test_a_scan_that_cannot_be_used_says_why() -> None:
    made, _ = drive(Scanner(), steps=5)
    ranges, step = scan(START, Scanner(), 90), 2 * math.pi / 90
    before = made.amcl.particles.copy()
    assert made.add_scan(0.5, ranges, -math.pi, step) == Heard.LATE  # the same once more
    assert made.add_scan(-3.0, ranges, -math.pi, step) == Heard.LATE
    assert made.add_scan(2.0, ranges, -math.pi, step) == Heard.EARLY
    np.testing.assert_array_equal(before, made.amcl.particles)
    made.add_odometry(0.6, made.odometer.at(0.5))
    assert made.add_scan(0.6, ranges, -math.pi, step) == Heard.STILL
    made.add_odometry(0.7, [1e7, 0.0, 0.0])
    assert made.add_scan(0.7, ranges, -math.pi, step) == Heard.BAD_ODOMETRY


def test_blind_scans_widen_the_belief_and_count_as_silence() -> None:
    made, truth = drive(Scanner(), steps=10)
    sure = made.health(1.0)
    assert sure.silence == 0.0 and sure.echoes == 90 and sure.agreement > 0.9
    assert sure.second_cluster == 0.0 and 0.0 < sure.effective_share <= 1.0
    odometry = made.odometer.at(1.0)
    for k in range(1, 11):
        odometry, truth = compose(odometry, [0.05, 0.0, 0.0]), compose(truth, [0.05, 0.0, 0.0])
        made.add_odometry(1.0 + 0.1 * k, odometry)
        nothing = np.full(90, math.nan if k % 2 else math.inf, np.float32)
        assert made.add_scan(1.0 + 0.1 * k, nothing, -math.pi, 0.07) == Heard.BLIND
    doubtful = made.health(2.0)
    assert doubtful.silence == pytest.approx(1.0) and doubtful.echoes == 0
    assert doubtful.deviation > 1.2 * sure.deviation
    assert off(made, truth) < 0.1  # it followed the wheels


def test_prediction_alone_moves_and_nothing_else() -> None:
    laser = LaserConfig()
    amcl = AMCL(LikelihoodMap.build(GRID, CONFIG, laser), CONFIG, laser)
    with pytest.raises(ValueError, match="reset first"):
        amcl.predict(np.zeros(3))
    amcl.reset(START, stream_state(2))
    averages = amcl.averages.copy()
    assert not amcl.predict(np.zeros(3)) and not amcl.predict(np.array([math.nan, 0.0, 0.0]))
    assert amcl.predict(np.array([1.0, 0.0, 0.0]))
    ahead = compose(START, [1.0, 0.0, 0.0])
    assert amcl.pose_estimated[:2] == pytest.approx(ahead[:2], abs=0.03)
    assert amcl.count == 600 and (amcl.averages == averages).all()
    with pytest.raises(ValueError, match=r"odometry \(3,\)"):
        amcl.predict(np.zeros(2))


def test_a_copy_keeps_its_scanner() -> None:
    made, _ = drive(Scanner(x=0.2), steps=3)
    twin = copy.deepcopy(made.amcl)
    ranges = scan(START, Scanner(x=0.2), 60)
    bearings = Scanner().bearings(-math.pi, 2 * math.pi / 60, 60)
    for amcl in (made.amcl, twin):
        amcl.update(np.array([1.0, 0.0, 0.0]), ranges, bearings)
    np.testing.assert_array_equal(made.amcl.particles, twin.particles)


def test_the_beam_model_looks_from_where_the_scanner_is() -> None:
    config = CONFIG.model_copy(update={"laser_model_type": "beam", "do_beamskip": False})
    config = LocalizationConfig(**config.model_dump() | {"laser_max_beams": 12})
    scanner = Scanner(x=0.25)
    weights = []
    for told in (scanner, Scanner()):
        made = SensorFilter(GRID, config, told)
        made.reset(START, stream_state(1), np.zeros(3))
        made.add_odometry(0.0, np.zeros(3))
        truth = START.copy()
        for k in range(1, 16):
            truth = compose(truth, [0.05, 0.0, 0.1])
            made.add_odometry(0.1 * k, compose(read(made, 0.1 * (k - 1)), [0.05, 0.0, 0.1]))
            made.add_scan(0.1 * k, scan(truth, scanner, 12), -math.pi, math.tau / 12)
        weights.append(off(made, truth))
    assert weights[0] < 0.06 and weights[0] < weights[1]
