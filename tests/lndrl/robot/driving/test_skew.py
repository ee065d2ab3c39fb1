"""Scans that were taken while the robot moved, against those of a robot that stood."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from lndrl.localization import Scanner
from lndrl.robot.driving.belief import RobotLocalization
from lndrl.robot.driving.odometry import Wheels
from lndrl.robot.driving.scans import about_base
from lndrl.robot.driving.senses import Senses
from lndrl.robot.driving.skew import at_one_moment
from lndrl.robot.messages import SECOND, Odometry, Scan
from tests.lndrl.robot.rig import config_of

SIDE = 4.0  # m from the middle of a square room to its walls
SWEEP = 0.1  # s
START = 10 * SECOND


def reading(pose: NDArray[np.float64], bearing: float) -> float:
    """m to the room's wall, from ``pose`` (x, y, yaw) towards ``bearing`` in its frame."""
    c, s = np.cos(pose[2] + bearing), np.sin(pose[2] + bearing)
    x = (np.copysign(SIDE, c) - pose[0]) / c if abs(c) > 1e-9 else np.inf
    y = (np.copysign(SIDE, s) - pose[1]) / s if abs(s) > 1e-9 else np.inf
    return float(min(x, y))


def pose_at(seconds: float, v: float, w: float) -> NDArray[np.float64]:
    """The base (x, y, yaw) after so long on an arc."""
    if w == 0.0:
        return np.array([0.3 + v * seconds, -0.5, 0.2])
    r, yaw = v / w, 0.2 + w * seconds
    return np.array([0.3 + r * (np.sin(yaw) - np.sin(0.2)), -0.5 - r * (np.cos(yaw) - np.cos(0.2)),
                     yaw])  # fmt: skip


def swept(scanner: Scanner, scan: Scan, v: float, w: float) -> Scan:
    """``scan`` with what it measures beam by beam."""
    count = len(scan.ranges)
    local = scanner.bearings(scan.angle_min, scan.angle_increment, count).astype(float)
    ranges = np.empty(count, np.float32)
    for i in range(count):
        base = pose_at(i * scan.time_increment, v, w)
        c, s = np.cos(base[2]), np.sin(base[2])
        x = base[0] + c * scanner.x - s * scanner.y
        y = base[1] + s * scanner.x + c * scanner.y
        ranges[i] = reading(np.array([x, y, base[2]]), local[i])
    return replace(scan, ranges=ranges)


def wheels_of(v: float, w: float) -> Wheels:
    wheels = Wheels()
    for seconds in (-0.1, 0.0, 0.05, 0.1, 0.15):
        wheels.add(Odometry(START + round(seconds * SECOND), "", "", pose_at(seconds, v, w)))
    return wheels


ALL_ROUND = (-np.pi, 2.0 * np.pi / 720, 720)
IN_FRONT = (-2.0, 4.0 / 480, 481)


@pytest.mark.parametrize(("v", "w"), [(0.6, 0.0), (0.0, 0.9), (0.5, -0.9)])
@pytest.mark.parametrize("fan", [ALL_ROUND, IN_FRONT, (np.pi, -2.0 * np.pi / 800, 801)])
@pytest.mark.parametrize(
    "mount", [Scanner(), Scanner(0.2, -0.1, 2.5), Scanner(0.1, 0.0, 0.4, True)]
)
def test_a_moving_scan_is_made_that_of_a_robot_that_stands(
    v: float, w: float, fan: tuple[float, float, int], mount: Scanner
) -> None:
    first, step, count = fan
    empty = Scan(START, "", first, step, 0.0, 12.0, np.zeros(count, np.float32), SWEEP / count)
    moving = swept(mount, empty, v, w)
    still = swept(mount, replace(empty, time_increment=0.0), 0.0, 0.0)
    found = at_one_moment(moving, mount, wheels_of(v, w))
    assert found.stamp == START and len(found.ranges) == count
    before = np.abs(moving.ranges - still.ranges)
    # To within a beam's width, on walls that stand askew to it; at the fan's ends nobody knows.
    inner = np.s_[:] if count * abs(step) > 6.0 else np.s_[8:-8]
    after = np.abs(found.ranges - still.ranges)[inner]
    assert np.median(after) < 0.01 and np.quantile(after, 0.98) < 2.0 * abs(step) * SIDE
    assert before.mean() > 2.5 * after.mean()


def test_what_is_no_echo_stays_none_and_turns_with_the_rest() -> None:
    first, step, count = ALL_ROUND
    empty = Scan(START, "", first, step, 0.1, 12.0, np.zeros(count, np.float32), SWEEP / count)
    moving = swept(Scanner(), empty, 0.0, 0.9)
    moving.ranges[200:220] = np.inf
    moving.ranges[600:640] = np.nan
    scanner = Scanner(range_min=0.1, range_max=12.0)
    found = at_one_moment(moving, scanner, wheels_of(0.0, 0.9)).ranges
    turned = 0.9 * SWEEP / step  # beams, at the end
    assert 19 <= np.isinf(found).sum() <= 21 and 39 <= np.isnan(found).sum() <= 41
    assert abs(np.flatnonzero(np.isinf(found)).mean() - 209.5 - turned * 209.5 / count) <= 1.0
    assert abs(np.flatnonzero(np.isnan(found)).mean() - 619.5 - turned * 619.5 / count) <= 1.0
    base = about_base(replace(moving, ranges=found), scanner)
    assert np.isinf(base.ranges).sum() == np.isinf(found).sum() + np.isnan(found).sum()


def test_scans_that_are_left_as_they_are() -> None:
    first, step, count = ALL_ROUND
    scan = Scan(START, "", first, step, 0.0, 12.0, np.full(count, 2.0, np.float32), SWEEP / count)
    moving = wheels_of(0.0, 0.9)
    for each in (
        replace(scan, time_increment=0.0),
        replace(scan, time_increment=-1e-4),
        replace(scan, time_increment=float("nan")),
        replace(scan, time_increment=0.1),  # longer than any scanner
        replace(scan, stamp=START + SECOND),  # of which the wheels know nothing
    ):
        assert at_one_moment(each, Scanner(), moving) is each
    assert at_one_moment(scan, Scanner(), wheels_of(0.0, 0.0)) is scan
    assert at_one_moment(scan, Scanner(), Wheels()) is scan
    assert at_one_moment(scan, Scanner(), moving) is not scan


def test_what_a_drive_goes_by_is_of_one_moment() -> None:
    first, step, count = ALL_ROUND
    empty = Scan(START, "", first, step, 0.0, 12.0, np.zeros(count, np.float32), SWEEP / count)
    moving = swept(Scanner(), empty, 0.0, 0.9)
    senses = Senses(RobotLocalization(config_of()), 0.2, mount=Scanner())
    for seconds in (-0.1, 0.0, 0.05, 0.1, 0.15):
        pose = pose_at(seconds, 0.0, 0.9)
        reading_ = Odometry(START + round(seconds * SECOND), "odom", "base_link", pose)
        senses.take("odometry", reading_, seconds, None)
    senses.take("scan", moving, 0.2, None)
    expected = at_one_moment(moving, Scanner(), wheels_of(0.0, 0.9)).ranges
    assert senses.scan is not None
    np.testing.assert_allclose(senses.scan.own.ranges, expected, atol=1e-5)
    assert np.abs(moving.ranges - expected).max() > 0.05
