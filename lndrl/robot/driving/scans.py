"""A scanner's readings as the base sees them, and as the policy expects them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lndrl.config import LaserConfig
from lndrl.localization import Scanner
from lndrl.robot.driving.reasons import Reason
from lndrl.robot.messages import Scan

Floats = NDArray[np.float64]

_BLIND = 0.9
"""Share of beams that say nothing, by NaN or by a reading at or below the minimum."""
_CHANGED = 0.1
"""Share by which the number of beams may differ from one scan to the next: motors vary a little."""
_MOST_BEAMS = 20_000


@dataclass(frozen=True)
class BaseScan:
    """A scan about the base: ``bearings`` rising (rad, in [-pi, pi)), ``ranges`` (m) of float32
    (n,), infinity for no echo. ``own`` is the message that it is made of, and ``scanner`` where
    the scanner stands and between which ranges it sees.
    """

    stamp: int
    bearings: NDArray[np.float32]
    ranges: NDArray[np.float32]
    increment: float
    own: Scan
    scanner: Scanner

    @property
    def own_bearings(self) -> NDArray[np.float32]:
        """(n,) rad in the base's frame, of the message's readings in their order."""
        own = self.own
        return self.scanner.bearings(own.angle_min, own.angle_increment, len(own.ranges))


def fault(scan: Scan, before: Scan | None) -> tuple[Reason, str] | None:
    """What makes ``scan`` useless, in words; ``before`` is the last one that came."""
    angles = np.array([scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max])
    count = len(scan.ranges)
    if not np.isfinite(angles).all() or scan.angle_increment == 0.0:
        return Reason.SCAN_INVALID, "a scan's angles or limits are not finite, or do not grow"
    if not 0.0 <= scan.range_min < scan.range_max:
        least, most = scan.range_min, scan.range_max
        return Reason.SCAN_INVALID, f"a scan says that it reaches from {least:g} m to {most:g} m"
    if not 2 <= count <= _MOST_BEAMS:
        return Reason.SCAN_INVALID, f"a scan has {count} beams"
    if abs(scan.angle_increment) * (count - 1) > 2.0 * np.pi + abs(scan.angle_increment):
        return Reason.SCAN_INVALID, "a scan turns by more than once around"
    if before is not None:
        was = len(before.ranges)
        if abs(count - was) > max(2, _CHANGED * was):
            return Reason.SCAN_CHANGED, f"a scan has {count} beams, the one before had {was}"
        if scan.range_max != before.range_max:
            most = before.range_max
            return Reason.SCAN_CHANGED, f"a scan reaches {scan.range_max:g} m, not {most:g} m"
    silent = np.isnan(scan.ranges) | (scan.ranges <= scan.range_min)
    if float(silent.mean()) > _BLIND:
        return Reason.SCAN_BLIND, f"{int(silent.sum())} of {count} beams say nothing"
    return None


def about_base(scan: Scan, scanner: Scanner) -> BaseScan:
    """``scan`` seen from the base, of a ``scanner`` that stands there.

    A reading at or below the scanner's minimum is no echo, as are NaN and all at or beyond its
    maximum. Beams without an echo keep their direction.
    """
    angle = scanner.bearings(scan.angle_min, scan.angle_increment, len(scan.ranges))
    angle = angle.astype(np.float64)
    readings = scanner.echoes(scan.ranges).astype(np.float64)
    echo = readings < np.float32(scanner.range_max)  # false for NaN
    reach = np.where(echo, readings, 0.0)
    x, y = scanner.x + reach * np.cos(angle), scanner.y + reach * np.sin(angle)
    bearing = np.where(echo, np.arctan2(y, x), np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)
    bearing[bearing >= np.pi] -= 2.0 * np.pi
    ranges = np.where(echo, np.hypot(x, y), np.inf)
    order = np.argsort(bearing, kind="stable")
    return BaseScan(
        scan.stamp,
        bearing[order].astype(np.float32),
        ranges[order].astype(np.float32),
        abs(scan.angle_increment),
        scan,
        scanner,
    )


def scanner_of(scan: Scan, mount: Scanner, limits: tuple[float, float] | None) -> Scanner | None:
    """A scanner that stands as ``mount`` and sees as far as ``scan`` says, and no farther than
    ``limits`` (least and most, m) where they are known; None where nothing is left between them.
    """
    least, most = scan.range_min, scan.range_max
    if limits is not None:
        least, most = max(least, limits[0]), min(most, limits[1])
    return None if most <= least else replace(mount, range_min=least, range_max=most)


def as_trained(scan: BaseScan, laser: LaserConfig) -> NDArray[np.float32]:
    """Ranges (beams,) at the bearings of ``laser``: the nearest echo of those beams that fall to
    a bearing, else the nearest beam; infinity for no echo, and where the scanner does not look.
    """
    step = laser.field_of_view / laser.beams
    first = -0.5 * laser.field_of_view
    place = np.rint((scan.bearings.astype(np.float64) - first) / step).astype(np.int64)
    out = np.full(laser.beams, np.inf, np.float32)
    inside = (place >= 0) & (place < laser.beams)
    np.minimum.at(out, place[inside], scan.ranges[inside])
    # A coarser scanner leaves gaps: bearings without a beam of their own take their neighbour's.
    hit = np.zeros(laser.beams, bool)
    hit[place[inside]] = True
    if not hit.all():
        wanted = first + step * np.flatnonzero(~hit)
        beam = _nearest(scan.bearings, wanted)
        away = np.abs(scan.bearings[beam] - wanted)
        out[~hit] = np.where(away <= scan.increment, scan.ranges[beam], np.float32(np.inf))
    return out


def uncovered(scan: BaseScan, laser: LaserConfig) -> float:
    """Share of the bearings of ``laser`` where the scanner does not look."""
    step = laser.field_of_view / laser.beams
    wanted = -0.5 * laser.field_of_view + step * np.arange(laser.beams)
    beam = _nearest(scan.bearings, wanted)
    away = np.abs(scan.bearings[beam] - wanted)
    return float((away > max(scan.increment, step)).mean())


def _nearest(bearings: NDArray[np.float32], wanted: NDArray[np.floating]) -> NDArray[np.int64]:
    """Index of the nearest of the rising ``bearings`` for each of ``wanted``."""
    after = np.searchsorted(bearings, wanted).clip(1, max(len(bearings) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(bearings) - 1)
    nearer = np.abs(bearings[before] - wanted) <= np.abs(bearings[after] - wanted)
    return np.where(nearer, before, after)
