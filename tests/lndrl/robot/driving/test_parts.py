"""The parts of a drive, one by one: scans, wheels, frames, people, maps, limits."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from lndrl.config import LaserConfig
from lndrl.localization import Scanner
from lndrl.maps.grid import OccupancyGrid
from lndrl.robot.driving import RobotMap, mounted
from lndrl.robot.driving.frames import Frames, planar
from lndrl.robot.driving.maps import MapFaultError
from lndrl.robot.driving.odometry import Wheels
from lndrl.robot.driving.people import Follower
from lndrl.robot.driving.reasons import Reason, in_order
from lndrl.robot.driving.scans import BaseScan, about_base, as_trained, fault, scanner_of, uncovered
from lndrl.robot.geometry import between, chained, interpolated, inverse, rotation
from lndrl.robot.messages import (
    SECOND,
    GridMap,
    Odometry,
    Poses,
    Scan,
    Transform,
    Transforms,
)

LASER = LaserConfig()
FIRST, STEP = -np.pi / 2, np.pi / 720


def scan(ranges: np.ndarray, first: float = FIRST, step: float = STEP) -> Scan:
    return Scan(7, "laser", first, step, 0.15, 12.0, np.asarray(ranges, np.float32))


def seen_from(scan: Scan, mount: Scanner | None = None) -> BaseScan:
    scanner = scanner_of(scan, mount or Scanner(), None)
    assert scanner is not None
    return about_base(scan, scanner)


def test_a_scan_of_the_trained_kind_passes_as_it_is() -> None:
    ranges = np.linspace(0.5, 11.0, 720).astype(np.float32)
    ranges[[5, 100, 300]] = np.inf, 12.0, 0.1  # none, at the maximum, below the minimum
    seen = seen_from(scan(ranges))
    trained = as_trained(seen, LASER)
    expected = ranges.copy()
    expected[[5, 100, 300]] = np.inf
    assert np.allclose(trained, expected, rtol=1e-6)
    assert uncovered(seen, LASER) == 0.0
    assert np.allclose(seen.own_bearings, FIRST + STEP * np.arange(720), atol=1e-6)


def test_what_a_robots_file_says_of_its_scanner_holds_beside_the_message() -> None:
    one = scan(np.ones(720))
    assert scanner_of(one, Scanner(x=0.1), (0.3, 4.0)) == Scanner(
        x=0.1, range_min=0.3, range_max=4.0
    )
    assert scanner_of(one, Scanner(), (0.0, 30.0)) == Scanner(range_min=0.15, range_max=12.0)
    assert scanner_of(one, Scanner(), (13.0, 30.0)) is None
    near = np.linspace(0.1, 8.0, 720)
    scanner = scanner_of(scan(near), Scanner(), (0.3, 4.0))
    assert scanner is not None
    hit = np.isfinite(about_base(scan(near), scanner).ranges)
    assert (hit == ((near > 0.3) & (near < 4.0))).all()


@pytest.mark.parametrize("count", [181, 360, 1600])
def test_any_number_of_beams_becomes_the_trained_ones(count: int) -> None:
    # A wall 2 m ahead, across; seen all around.
    step = 2 * np.pi / count
    angle = -np.pi + step * np.arange(count)
    with np.errstate(divide="ignore"):
        ranges = np.where(np.cos(angle) > 0.2, 2.0 / np.cos(angle), np.inf)
    trained = as_trained(seen_from(scan(ranges, -np.pi, step)), LASER)
    wanted = FIRST + STEP * np.arange(720)
    hit = np.isfinite(trained)
    assert hit[np.cos(wanted) > 0.25].all() and not hit[np.cos(wanted) < 0.15].any()
    across = trained[hit] * np.cos(wanted[hit])
    assert np.abs(across - 2.0).max() < 2.0 * np.tan(1.3) * step + 1e-3


def test_where_a_scanner_does_not_look_there_is_no_echo() -> None:
    narrow = seen_from(scan(np.ones(200), -0.5, 0.005))
    trained = as_trained(narrow, LASER)
    wanted = FIRST + STEP * np.arange(720)
    assert np.isfinite(trained[np.abs(wanted) < 0.45]).all()
    assert np.isinf(trained[np.abs(wanted) > 0.55]).all()
    assert uncovered(narrow, LASER) == pytest.approx(1.0 - 1.0 / np.pi, abs=0.02)


def matrix_of(scanner: Scanner) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation(scanner.yaw) @ np.diag(
        [1, -1, -1] if scanner.upside_down else [1] * 3
    )
    matrix[:2, 3] = scanner.x, scanner.y
    return matrix


@pytest.mark.parametrize("upside_down", [False, True])
def test_points_are_where_they_are_wherever_the_scanner_is(upside_down: bool) -> None:
    scanner = Scanner(0.2, -0.1, 2.0, upside_down)
    mounting = matrix_of(scanner)
    assert mounted(mounting) == scanner
    echoes = np.array([[2.0, 1.0], [1.5, -1.0], [3.0, 0.1]])  # on the base
    seen = (np.linalg.inv(mounting) @ np.array([[x, y, 0.0, 1.0] for x, y in echoes]).T)[:2].T
    angle = np.arctan2(seen[:, 1], seen[:, 0])
    order = np.argsort(angle)
    ranges = np.full(5000, np.inf, np.float32)
    step = 2 * np.pi / 5000
    ranges[np.rint((angle + np.pi) / step).astype(int) % 5000] = np.hypot(*seen.T)
    found = seen_from(scan(ranges, -np.pi, step), scanner)
    hit = np.isfinite(found.ranges)
    reach, bearing = found.ranges[hit], found.bearings[hit]
    points = np.stack([reach * np.cos(bearing), reach * np.sin(bearing)], axis=1)
    expected = echoes[np.argsort(np.arctan2(echoes[:, 1], echoes[:, 0]))]
    assert len(order) == 3 and np.abs(points - expected).max() < 0.005
    assert (np.diff(found.bearings) >= 0).all()


def test_a_motor_may_vary_a_little() -> None:
    before = scan(np.ones(720))
    assert fault(scan(np.ones(700)), before) is None
    wrong = fault(scan(np.ones(600)), before)
    assert wrong is not None and wrong[0] is Reason.SCAN_CHANGED
    assert fault(scan(np.full(720, np.inf)), before) is None, "an open field is no fault"


def reading(stamp: float, x: float, yaw: float = 0.0) -> Odometry:
    return Odometry(round(stamp * SECOND), "odom", "base", np.array([x, 0.0, yaw]))


def test_wheels_are_read_between_two_readings() -> None:
    wheels = Wheels()
    assert wheels.at(0) is None
    for k in range(5):
        assert wheels.add(reading(10 + 0.1 * k, 0.05 * k, 3.0 + 0.1 * k)) is None
    here = wheels.at(round(10.25 * SECOND))
    assert here is not None and here[0] == pytest.approx(0.125)
    assert here[2] == pytest.approx(3.25 - 2 * np.pi)
    ahead = wheels.at(round(10.45 * SECOND))
    assert ahead is not None and ahead[0] == pytest.approx(0.225), "as it went on"
    assert wheels.at(round(10.7 * SECOND)) is None
    assert wheels.at(round(9.0 * SECOND)) is None
    assert wheels.add(reading(10.2, 9.0)) is None
    newest = wheels.at(round(10.4 * SECOND))
    assert newest is not None and newest[0] == pytest.approx(0.2), "late ones are left out"
    jump = wheels.add(reading(10.5, 2.0))
    assert jump is not None and jump[0] is Reason.ODOMETRY_JUMPED
    turned = Wheels()
    turned.add(reading(1.0, 0.0))
    spun = turned.add(reading(1.1, 0.0, 2.0))
    assert spun is not None and spun[0] is Reason.ODOMETRY_JUMPED and "115°" in spun[1]


def test_frames_are_chained_both_ways_and_circles_end() -> None:
    frames = Frames()
    at = np.array([1.0, 0.0, 0.0])
    frames.add(Transforms((Transform(0, "map", "odom", at, rotation(np.pi / 2)),)))
    frames.add(Transforms((Transform(0, "odom", "base", at, np.eye(3)),)))
    found = frames.find("map", "base")
    assert found is not None and planar(found) == pytest.approx([1.0, 1.0, np.pi / 2])
    back = frames.find("base", "map")
    assert back is not None and planar(back) == pytest.approx(inverse(planar(found)))
    assert frames.find("map", "elsewhere") is None
    broken = Transform(0, "odom", "base", np.array([np.nan, 0.0, 0.0]), np.eye(3))
    frames.add(Transforms((broken,)))
    assert frames.find("map", "base") is not None
    frames.add(Transforms((Transform(0, "base", "map", at, np.eye(3)),)))
    assert frames.find("nowhere", "base") is None


def test_poses_are_chained_and_inverted() -> None:
    one, other = np.array([1.0, 2.0, 2.5]), np.array([0.3, -0.2, 1.5])
    assert between(one, chained(one, other)) == pytest.approx(other)
    assert chained(one, inverse(one)) == pytest.approx(np.zeros(3))
    middle = interpolated(np.array([0.0, 0.0, 3.0]), np.array([1.0, 0.0, -3.0]), 0.5)
    assert abs(abs(middle[2]) - np.pi) < 1e-9, "the shorter way"


def test_people_without_velocities_are_followed() -> None:
    follower, generator = Follower(), np.random.default_rng(0)
    start, velocity = np.array([[0.0, 0.0], [2.0, 0.0]]), np.array([[0.5, 0.0], [0.0, -0.4]])
    for k in range(20):
        there = start + 0.1 * k * velocity + generator.normal(0.0, 0.005, (2, 2))
        order = generator.permutation(2)
        poses = np.column_stack([there[order], np.zeros(2)])
        seen = follower.follow(Poses(round((1 + 0.1 * k) * SECOND), "odom", poses))
    assert np.abs(seen.velocity - velocity[order]).max() < 0.15
    gone = follower.follow(Poses(4 * SECOND, "odom", np.array([[9.0, 9.0, 0.0]])))
    assert gone.velocity.tolist() == [[0.0, 0.0]], "who has just appeared stands"
    nobody = follower.follow(Poses(5 * SECOND, "odom", np.zeros((0, 3))))
    assert len(nobody.position) == 0


def test_maps_of_three_kinds_of_cells() -> None:
    cells = np.full((40, 60), 0, np.int8)
    cells[0], cells[-1], cells[:, 0], cells[:, -1] = 100, 100, 100, 65
    cells[10:20, 30:50] = -1
    found = RobotMap.of_message(GridMap(0, "map", 0.1, np.array([-1.0, -2.0, 0.0]), cells), 0.17)
    assert found.grid.origin == (-1.0, -2.0) and found.grid.occupied[15, 40]
    assert found.grid.unknown is not None and found.grid.unknown[15, 40]
    assert found.fault_of_goal(np.array([1.0, 0.5]), None) is None
    wall = found.fault_of_goal(np.array([-0.95, 0.0]), None)
    assert wall is not None and wall[0] is Reason.GOAL_IN_WALL
    again = RobotMap.of_message(GridMap(9, "map", 0.1, np.array([-1.0, -2.0, 0.0]), cells), 0.17)
    assert again.same_as(found) and not found.same_as(None)
    with pytest.raises(MapFaultError, match="no free cell"):
        RobotMap.of_message(GridMap(0, "map", 0.1, np.zeros(3), np.full((4, 4), 100, np.int8)), 0.1)


def test_an_area_is_found_beside_an_estimate_that_is_a_little_off() -> None:
    occupied = np.zeros((40, 60), bool)
    occupied[:, 30] = True
    found = RobotMap.of_grid("map", OccupancyGrid(np.pad(occupied, 1, constant_values=True), 0.1),
                             0.2)  # fmt: skip
    left, right = found.area_near(np.array([1.0, 2.0, 0.0])), found.area_near(np.array([5, 2, 0]))
    assert left != right and left > 0 and right > 0
    assert found.area_near(np.array([0.12, 2.0, 0.0])) == left
    assert found.area_near(np.array([-50.0, 2.0, 0.0])) == 0


def test_the_first_reason_is_the_one_to_mend_first() -> None:
    stops = in_order({Reason.NO_GOAL: "none", Reason.SCAN_STALE: "old", Reason.LINK_LOST: "cut"})
    assert [stop.reason.label for stop in stops] == ["link_lost", "scan_stale", "no_goal"]
    assert str(stops[1]).startswith("scan_stale: old; check the scanner")
    assert Reason.NO_GOAL.is_rest and not Reason.SCAN_STALE.is_rest


def test_every_reason_is_explained_in_the_docs() -> None:
    page = Path(__file__).resolve().parents[4] / "docs" / "robot.md"
    explained = set(re.findall(r"`([a-z_]+)`", page.read_text("utf-8")))
    assert {reason.label for reason in Reason} <= explained
