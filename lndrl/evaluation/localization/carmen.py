"""Laser logs of real robots in CARMEN's text format, with corrected poses to compare with.

A line is a message. Read are ``FLASER`` (a scan, the laser's pose, the odometer's pose, a stamp),
``ROBOTLASER1`` (the same with the scanner's own angles) and ``ODOM``. Public logs come corrected
in two ways: either a scan's first pose is corrected and its second is the odometer's, or, as
gmapping writes them, both are corrected and every ``ODOM`` is the odometer's motion continued from
the last corrected pose. Either way the raw odometry can be put together again.
"""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.localization import compose, relative

Floats = NDArray[np.float64]

_SAME = 1e-4  # m, rad: poses that are printed with six digits
_FLAT = math.pi  # rad, field of view of a FLASER
LEAST_SCANS = 20


@dataclass(frozen=True, eq=False)
class LaserLog:
    """n scans of one drive; poses are [x, y, yaw] (m, rad).

    ``truth`` and ``odometry`` ``(n, 3)``: the corrected pose at a scan, and the raw odometer's
    from (0, 0, 0) at the first one. ``ranges`` float32 ``(n, beams)`` m, ``bearings`` ``(beams,)``
    rad from the robot's x axis, ``farthest`` (m) the range from which on a reading is none.
    """

    name: str
    truth: Floats
    odometry: Floats
    ranges: NDArray[np.float32]
    bearings: NDArray[np.float32]
    farthest: float

    @property
    def length(self) -> float:
        """Metres driven."""
        return float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum())


@dataclass
class _Scan:
    ranges: NDArray[np.float32]
    first: Floats  # the pose that the log calls the laser's
    second: Floats  # the pose that it calls the odometer's
    moved: Floats  # from the last scan, as the ODOM lines between them say, in its frame


def load_carmen(path: Path) -> LaserLog:
    """Read a log, packed by gzip or not.

    Scans of another number of beams than the first are left out. Raises UserError naming file and
    line for what cannot be read, and for a log without corrected poses or with too few scans.
    """
    scans: list[_Scan] = []
    bearings: NDArray[np.float32] | None = None
    farthest = math.inf
    reference: Floats | None = None  # where the odometer continues from
    latest: Floats | None = None
    for number, words in _lines(path):
        try:
            if words[0] == "ODOM":
                latest = _pose(words[1:4])
                reference = latest if reference is None else reference
                continue
            ranges, angles, limit, poses = _scan_of(words)
        except (ValueError, IndexError):
            raise UserError(f"{path}, line {number}: no whole {words[0]} message") from None
        if bearings is None:
            bearings, farthest = angles, limit
        if len(ranges) != len(bearings):
            continue
        moved = np.zeros(3)
        if reference is not None and latest is not None:
            moved = relative(reference, latest)
        scans.append(_Scan(ranges, *poses, moved))
        reference = latest = poses[1]
    if bearings is None or len(scans) < LEAST_SCANS:
        raise UserError(
            f"{path}: {len(scans)} scans (FLASER or ROBOTLASER1 lines) of one kind; "
            f"a log needs {LEAST_SCANS}"
        )
    return _log(path, scans, bearings, farthest)


def _log(
    path: Path, scans: list[_Scan], bearings: NDArray[np.float32], farthest: float
) -> LaserLog:
    first = np.array([scan.first for scan in scans])
    second = np.array([scan.second for scan in scans])
    if np.abs(_turned(first - second)).max() > _SAME:
        odometry = _relative(second)
    else:
        odometry = np.zeros_like(first)
        for i in range(1, len(scans)):
            odometry[i] = compose(odometry[i - 1], scans[i].moved)
    driven, wheeled = (
        np.hypot(*np.diff(each[:, :2], axis=0).T).sum() for each in (first, odometry)
    )
    if wheeled < 0.5 * driven:
        raise UserError(
            f"{path}: its ODOM lines tell {wheeled:.0f} of {driven:.0f} m that were driven; "
            "without the odometer's motion between scans no filter can run"
        )
    if np.abs(_turned(odometry - _relative(first))).max() < _SAME * len(scans):
        raise UserError(
            f"{path}: all of its poses are the odometer's; only a corrected log says where the "
            "robot was"
        )
    name = path.name.split(".")[0].removesuffix("-corrected")
    ranges = np.array([scan.ranges for scan in scans], dtype=np.float32)
    return LaserLog(name, first, odometry, ranges, bearings, farthest)


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """(number, words) of the lines that matter."""
    wanted = ("ODOM ", "FLASER ", "ROBOTLASER1 ")
    opened = gzip.open if path.suffix == ".gz" else open
    try:
        with opened(path, "rt", encoding="ascii", errors="replace") as file:
            for number, line in enumerate(file, start=1):
                if line.startswith(wanted):
                    yield number, line.split()
    except FileNotFoundError:
        raise UserError(f"{path}: no such file") from None
    except (OSError, EOFError) as error:
        raise UserError(f"{path}: cannot be read ({error})") from None


def _scan_of(
    words: list[str],
) -> tuple[NDArray[np.float32], NDArray[np.float32], float, tuple[Floats, Floats]]:
    """Ranges, bearings, farthest reading, and the two poses of a scan; ValueError otherwise."""
    if words[0] == "FLASER":
        count = int(words[1])
        # 180 beams end a step short of the half turn, 181 are both ends of it.
        step = _FLAT / (count - count % 2)
        start, place, farthest = -0.5 * _FLAT, 2, math.inf
    else:
        start, step, farthest = float(words[2]), float(words[4]), float(words[5])
        count, place = int(words[8]), 9
    ranges = np.array(words[place : place + count], dtype=np.float32)
    rest = words[place + count :]
    if words[0] == "ROBOTLASER1":
        rest = rest[1 + int(rest[0]) :]  # remission values
    if len(ranges) != count or count < 1:
        raise ValueError
    bearings = (start + step * np.arange(count)).astype(np.float32)
    return ranges, bearings, farthest, (_pose(rest[0:3]), _pose(rest[3:6]))


def _pose(words: list[str]) -> Floats:
    x, y, yaw = (float(word) for word in words)
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(yaw)):
        raise ValueError
    return np.array([x, y, yaw])


def _relative(poses: Floats) -> Floats:
    """``poses`` (n, 3) as seen from the first."""
    return np.array([relative(poses[0], pose) for pose in poses])


def _turned(difference: Floats) -> Floats:
    """``difference`` (n, 3) of poses with the angles wrapped."""
    wrapped = difference.copy()
    wrapped[:, 2] = (wrapped[:, 2] + math.pi) % math.tau - math.pi
    return wrapped
