"""What a series of errors says: RMSE, lost or not, time to recover; and means over drives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.evaluation.metrics import Rate

Floats = NDArray[np.float64]

RECOVERED_WITHIN = 0.5  # m
RECOVERED_FOR = 2.0  # s
_RESAMPLES = 2000


def errors(estimated: Floats, truth: Floats) -> tuple[Floats, Floats]:
    """Distance (m) and absolute angle (rad) between poses ``(n, 3)``, each ``(n,)``."""
    position = np.hypot(estimated[:, 0] - truth[:, 0], estimated[:, 1] - truth[:, 1])
    turn = estimated[:, 2] - truth[:, 2]
    return position, np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi)


def rmse(error: Floats) -> float:
    """Root of the mean square of ``error`` (n,)."""
    return float(np.sqrt(np.mean(np.square(error))))


def lost_ticks(
    position: Floats, yaw: Floats, lost_distance: float, lost_angle: float
) -> NDArray[np.bool_]:
    """Where the estimate is farther off than ``lost_distance`` (m) or ``lost_angle`` (rad)."""
    lost: NDArray[np.bool_] = (position > lost_distance) | (yaw > lost_angle)
    return lost


def recovery_seconds(
    position: Floats,
    tick: float,
    within: float = RECOVERED_WITHIN,
    lasting: float = RECOVERED_FOR,
) -> float | None:
    """Seconds until ``position`` errors (n,) fall below ``within`` m and stay so for ``lasting`` s.

    Entry i is the error (i + 1) ticks after the start, so the least is one tick. None when the
    series ends before.
    """
    needed = max(1, round(lasting / tick))
    run = 0
    for i, error in enumerate(position):
        run = run + 1 if error < within else 0
        if run == needed:
            return (i + 2 - needed) * tick
    return None


def censored_median(times: Sequence[float | None]) -> float | None:
    """Median where None is longer than anything; None when the median is, or without times."""
    if not times:
        return None
    known = sorted(math.inf if time is None else time for time in times)
    middle = 0.5 * (known[(len(known) - 1) // 2] + known[len(known) // 2])
    return middle if math.isfinite(middle) else None


def mean_interval(values: Sequence[float]) -> tuple[float, float]:
    """95 % bootstrap percentile interval of the mean; the same values give the same interval."""
    data = np.asarray(values, dtype=np.float64)
    generator = np.random.default_rng(0)
    means = data[generator.integers(len(data), size=(_RESAMPLES, len(data)))].mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)


@dataclass(frozen=True, eq=False)
class Outcome:
    """One setting on one drive.

    RMSE in m and rad over the whole drive, ``worst`` the largest position error (m), ``lost``
    whether it was ever lost, ``lost_time`` the share of ticks that it was. ``particles`` and
    ``effective`` (1 / sum of squared weights) are means over the updates,
    ``microseconds`` the median time of one. ``recovery``: seconds by kind of trouble, None where
    it never recovered. ``errors`` (n,) position errors (m).
    """

    setting: str
    scenario: str
    pedestrians: int
    seed: int
    position_rmse: float
    yaw_rmse: float
    worst: float
    lost: bool
    lost_time: float
    particles: float
    effective: float
    microseconds: float
    recovery: dict[str, float | None]
    errors: NDArray[np.float32]

    def to_dict(self) -> dict[str, Any]:
        """Plain types under the field names, without the series."""
        names = [name for name in self.__dataclass_fields__ if name != "errors"]
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class Cell:
    """One setting over all drives of a scenario and crowd; units as in ``Outcome``.

    ``position_rmse`` and ``yaw_rmse`` are means over drives, ``recovered`` and ``seconds`` by
    kind of trouble (the median, None when most never recovered).
    """

    setting: str
    scenario: str
    pedestrians: int
    drives: int
    position_rmse: float
    position_interval: tuple[float, float]
    position_median: float
    worst: float
    yaw_rmse: float
    yaw_median: float
    lost: Rate
    lost_time: float
    particles: float
    effective: float
    microseconds: float
    recovered: dict[str, Rate]
    seconds: dict[str, float | None]

    def to_dict(self) -> dict[str, Any]:
        """Plain types under the field names."""
        found = {name: getattr(self, name) for name in self.__dataclass_fields__}
        found["lost"] = self.lost.to_dict()
        found["recovered"] = {kind: rate.to_dict() for kind, rate in self.recovered.items()}
        found["position_interval"] = list(self.position_interval)
        return found


def cell_of(
    outcomes: Sequence[Outcome], scenario: str | None = None, pedestrians: int | None = None
) -> Cell:
    """Means over ``outcomes`` of one setting; ``scenario`` and ``pedestrians`` name the cell."""
    first = outcomes[0]
    positions = [o.position_rmse for o in outcomes]
    times = {kind: [o.recovery[kind] for o in outcomes] for kind in first.recovery}
    return Cell(
        setting=first.setting,
        scenario=first.scenario if scenario is None else scenario,
        pedestrians=first.pedestrians if pedestrians is None else pedestrians,
        drives=len(outcomes),
        position_rmse=float(np.mean(positions)),
        position_interval=mean_interval(positions),
        position_median=float(np.median(positions)),
        worst=max(o.worst for o in outcomes),
        yaw_rmse=float(np.mean([o.yaw_rmse for o in outcomes])),
        yaw_median=float(np.median([o.yaw_rmse for o in outcomes])),
        lost=Rate(sum(o.lost for o in outcomes), len(outcomes)),
        lost_time=float(np.mean([o.lost_time for o in outcomes])),
        particles=float(np.mean([o.particles for o in outcomes])),
        effective=float(np.mean([o.effective for o in outcomes])),
        microseconds=float(np.median([o.microseconds for o in outcomes])),
        recovered={
            kind: Rate(sum(t is not None for t in each), len(each)) for kind, each in times.items()
        },
        seconds={kind: censored_median(each) for kind, each in times.items()},
    )
