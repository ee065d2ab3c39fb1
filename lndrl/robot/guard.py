"""The guard over the commands of a real robot: scans as its scanner makes them, with their age.

``lndrl.planners.guard`` tells which paths are safe; this puts the echoes of a scanner that stands
anywhere on the base into the frame of the moment from which a command holds. docs/guard.md states
what is guaranteed, under which assumptions, and proves it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lndrl.localization import Scanner, compose
from lndrl.maps.grid import OccupancyGrid, distance_field
from lndrl.planners.guard import Guard, GuardConfig, borne_out, explained
from lndrl.world.odometry import Limits

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Base:
    """What the guard must know of a base: the ``radius`` (m) of the disc that holds the robot,
    ``limits`` (see ``lndrl.world.odometry``) on its velocities, and the s without a command after
    which it brakes by itself (``timeout``).
    """

    radius: float
    limits: Limits
    timeout: float


@dataclass(frozen=True)
class Sight:
    """What the guard makes of a scan: ``echoes`` (P, 2), m in the base's frame when it was taken;
    ``movable`` (P,): those that the map does not explain; ``beam`` (P,): whose they are.
    """

    echoes: Floats
    movable: Mask
    beam: NDArray[np.int64]


class CommandGuard:
    """Lets commands through, or takes the safe one among ``choices`` (A, 2) that is nearest.

    ``radius`` (m): of the disc around the base's middle that holds the robot. ``limits``: see
    ``lndrl.world.odometry``; None: it stops at once. A command holds for ``period`` s at most,
    then another follows or the robot brakes; with ``revised`` that may be after any tick of it.
    ``tick`` (s): in whose steps paths are predicted. ``grid``: the map whose obstacles are known to
    stand; None: everything may move.
    """

    def __init__(
        self,
        parameters: GuardConfig,
        radius: float,
        limits: Limits | None,
        choices: ArrayLike,
        period: float,
        tick: float = 0.1,
        grid: OccupancyGrid | None = None,
        revised: bool = False,
    ) -> None:
        self.parameters = parameters
        ticks = max(1, math.ceil(period / tick - 1e-9))
        # The longest first: it forbids most.
        held = range(ticks, 0, -1) if revised else [ticks]
        self._guards = [Guard(parameters, radius, limits, tick, k * tick) for k in held]
        self._choices = np.array(choices, dtype=np.float64).reshape(-1, 2)
        most = np.abs(self._choices).max(axis=0, initial=0.0)
        self._scale = np.where(most > 0.0, most, 1.0)
        self._grid = grid
        self._distance = None
        if grid is not None:
            # What nobody has seen is no wall that could be relied on.
            self._distance = distance_field(grid.mapped, grid.resolution)

    def look(
        self,
        ranges: ArrayLike,
        bearings: NDArray[np.floating],
        scanner: Scanner,
        pose: ArrayLike | None = None,
    ) -> Sight:
        """What a scan shows: ``ranges`` (n,) m at ``bearings`` (n,) rad in the base's frame.

        ``pose`` (3,) is the estimate of where the base was in the map then; None: not known, and
        everything may move.
        """
        clean = scanner.echoes(np.asarray(ranges)).astype(np.float64)
        real = np.empty(len(clean), np.bool_)
        borne_out(clean, scanner.range_max, self.parameters.pair, real)
        if _closes(bearings):  # the last beam's neighbour is the first
            one, other = float(clean[0]), float(clean[-1])
            met = 0.0 < one < scanner.range_max and 0.0 < other < scanner.range_max
            if met and abs(one - other) <= self.parameters.pair:
                real[[0, -1]] = True
        beam = np.flatnonzero(real)
        angle = np.asarray(bearings, np.float64)[beam]
        reach = clean[beam]
        echoes = np.stack(
            (scanner.x + reach * np.cos(angle), scanner.y + reach * np.sin(angle)), axis=1
        )
        movable = np.ones(len(beam), np.bool_)
        if self._distance is not None and self._grid is not None and pose is not None:
            p, grid = self.parameters, self._grid
            place = np.array(pose, np.float64)
            place[:2] -= grid.origin
            explained(
                echoes, place, self._distance, 1.0 / grid.resolution, p.map_tolerance,
                p.map_agreement, movable,
            )  # fmt: skip
        return Sight(echoes, movable, beam)

    def check(
        self,
        command: ArrayLike,
        velocity: ArrayLike,
        sight: Sight,
        moved: ArrayLike = (0.0, 0.0, 0.0),
        age: float = 0.0,
        choices: Callable[[], ArrayLike] | None = None,
        scores: ArrayLike | None = None,
    ) -> tuple[Floats, bool]:
        """What to tell the base, (2,) m/s and rad/s, and whether it is ``command`` itself.

        ``choices`` gives the (A, 2) that stand for those of this guard now; where ``scores`` (A,)
        are given, the highest of the safe ones is taken instead of the nearest.

        ``velocity`` (2,): of the base when the command takes effect; ``moved`` (3,): where it is
        then, as seen from where it was when the scan was taken; ``age`` (s): how much older the
        scan is then than ``GuardConfig.delay``. Standing still, or braking, is what is left where
        nothing is safe.
        """
        wanted = np.array(command, np.float64)
        if not np.isfinite(wanted).all():
            return np.zeros(2), False
        echoes = _seen_from(np.asarray(moved, np.float64), sight.echoes)
        start = np.array(velocity, np.float64)
        if self._safe(wanted[np.newaxis], start, echoes, sight.movable, age)[0]:
            return wanted, True
        others = self._choices if choices is None else np.array(choices(), np.float64)
        safe = self._safe(others, start, echoes, sight.movable, age)
        if not safe.any():
            return np.zeros(2), False
        liked = -np.abs((others - wanted) / self._scale).sum(axis=1)
        if scores is not None:
            liked = np.asarray(scores, np.float64)
        chosen: Floats = others[np.where(safe, liked, -np.inf).argmax()].copy()
        return chosen, False

    def _safe(
        self, commands: Floats, velocity: Floats, echoes: Floats, movable: Mask, age: float
    ) -> Mask:
        """Which of ``commands`` (A, 2) are safe, for however long they are held."""
        safe = np.ones(len(commands), np.bool_)
        for guard in self._guards:
            if (left := np.flatnonzero(safe)).size:
                safe[left] = guard.safe(commands[left], velocity, echoes, movable, age)
        return safe


def moved_by(velocity: ArrayLike, seconds: float, since: ArrayLike = (0.0, 0.0, 0.0)) -> Floats:
    """Where a base is after ``seconds`` more of ``velocity`` (2,), as ``CommandGuard.check`` wants
    it; ``since`` (3,): what the odometer says that it has moved since the scan.
    """
    v, w = (float(each) for each in np.asarray(velocity))
    half = 0.5 * w * seconds
    chord = v * seconds * float(np.sinc(half / np.pi))
    return compose(since, (chord * np.cos(half), chord * np.sin(half), 2.0 * half))


def braked_evenly(limits: Limits, fastest: float, tick: float) -> Limits:
    """``limits`` by which a path in steps of ``tick`` s, slower from each step's start on, ends no
    sooner than a base that brakes evenly within ``limits`` from ``fastest`` m/s; from any less, by
    an eighth of ``fastest * tick`` m at the most.
    """
    gain, loss, turn = limits
    if not (math.isfinite(loss) and fastest > 0.0):
        return limits
    return gain, loss * fastest / (fastest + loss * tick), turn


def _closes(bearings: NDArray[np.floating]) -> bool:
    """Whether a scan goes all around, so that its last beam looks beside its first."""
    if len(bearings) < 3:
        return False
    step, gap = (abs(math.remainder(float(bearings[k] - bearings[0]), math.tau)) for k in (1, -1))
    return gap <= 1.5 * step


def _seen_from(pose: Floats, points: Floats) -> Floats:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    offset = points - pose[:2]
    return np.stack((c * offset[:, 0] + s * offset[:, 1], c * offset[:, 1] - s * offset[:, 0]), 1)
