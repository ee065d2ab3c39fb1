"""Scans of a robot that moves while its scanner turns, as they would be had it stood still.

A beam i of sensor_msgs/LaserScan was measured ``i * time_increment`` after the stamp. At 0.9 rad/s
a scanner of 10 Hz has its last beam 5 degrees off its first.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lndrl.localization import Scanner, relative
from lndrl.robot.driving.odometry import Wheels
from lndrl.robot.messages import SECOND, Scan

Floats = NDArray[np.float64]

_SLOWEST = 0.5
"""s: no scanner takes longer for a scan, so who says so means something else."""
_NO_MATTER = (0.005, 0.002)
"""m and rad within a scan that are less than its noise."""


def at_one_moment(scan: Scan, scanner: Scanner, wheels: Wheels) -> Scan:
    """``scan`` as ``scanner`` would have seen all of it at its stamp, by what the wheels say.

    Beams keep their directions and number; where several echoes come to lie in one the nearest
    counts, and one that none comes to lie in has the nearest beam's. ``scan`` itself where the
    robot did not move, where beams have one time, or where the wheels do not know.
    """
    count = len(scan.ranges)
    lasts = scan.time_increment * (count - 1)
    if not 0.0 < lasts <= _SLOWEST:
        return scan
    begin, end = wheels.at(scan.stamp), wheels.at(scan.stamp + round(lasts * SECOND))
    if begin is None or end is None:
        return scan
    moved = relative(begin, end)
    if float(np.hypot(*moved[:2])) <= _NO_MATTER[0] and abs(moved[2]) <= _NO_MATTER[1]:
        return scan
    bearing, reach = _from_there(scan, scanner, moved * np.linspace(0.0, 1.0, count)[:, None])
    return replace(scan, ranges=_sorted_in(scan, scanner, bearing, reach))


def _from_there(scan: Scan, scanner: Scanner, moved: Floats) -> tuple[Floats, NDArray[np.float32]]:
    """Bearings (n,) about the base, and ranges, of what was read, from the scanner's first place.

    ``moved`` (n, 3) is where the base was at each of them. A reading that is no echo keeps its
    value.
    """
    count = len(scan.ranges)
    angle = scanner.bearings(scan.angle_min, scan.angle_increment, count).astype(np.float64)
    reading = scan.ranges.astype(np.float32)
    echo = _is_echo(reading, scanner)
    reach = np.where(echo, reading, 0.0).astype(np.float64)
    x, y = scanner.x + reach * np.cos(angle), scanner.y + reach * np.sin(angle)
    cosine, sine = np.cos(moved[:, 2]), np.sin(moved[:, 2])
    dx = moved[:, 0] + cosine * x - sine * y - scanner.x
    dy = moved[:, 1] + sine * x + cosine * y - scanner.y
    bearing = np.where(echo, np.arctan2(dy, dx), angle + moved[:, 2])
    return bearing, np.where(echo, np.hypot(dx, dy), reading).astype(np.float32)


def _sorted_in(
    scan: Scan, scanner: Scanner, bearing: Floats, reach: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Ranges (n,) for the beams of ``scan``, of readings at bearings (n,) about the base."""
    count, step = len(reach), scan.angle_increment
    own = scanner.yaw - bearing if scanner.upside_down else bearing - scanner.yaw
    middle = scan.angle_min + 0.5 * step * (count - 1)
    own = middle + np.remainder(own - middle + np.pi, 2.0 * np.pi) - np.pi
    place = np.rint((own - scan.angle_min) / step).astype(np.int64)
    turn = round(2.0 * np.pi / abs(step))
    if count >= turn - 1:  # it looks all round
        place = np.where((place < 0) | (place >= count), np.remainder(place, turn), place)
    inside = (place >= 0) & (place < count)
    place, reach = place[inside], reach[inside]
    echo = _is_echo(reach, scanner)
    found, near = np.full((2, count), np.inf, np.float32)
    found[place[~echo]] = reach[~echo]
    np.minimum.at(near, place[echo], reach[echo])
    found = np.where(np.isfinite(near), near, found)
    met = np.zeros(count, bool)
    met[place] = True
    return found[_nearest_of(met)]


def _is_echo(ranges: NDArray[np.float32], scanner: Scanner) -> NDArray[np.bool_]:
    return scanner.echoes(ranges) < np.float32(scanner.range_max)  # false for NaN


def _nearest_of(met: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Index (n,) of the nearest beam that is ``met`` (n,), of which there must be one."""
    here, there = np.arange(len(met)), np.flatnonzero(met)
    after = np.searchsorted(there, here).clip(max=len(there) - 1)
    before = (after - 1).clip(min=0)
    nearer = np.abs(there[before] - here) <= np.abs(there[after] - here)
    return np.where(nearer, there[before], there[after])
