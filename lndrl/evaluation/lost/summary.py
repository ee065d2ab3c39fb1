"""From traces to figures: how one gets lost, what came before, and how likely it was where.

All of it are pure functions of arrays; ``docs/lost.md`` says what the figures mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lndrl.evaluation.hazard import Hazard
from lndrl.evaluation.lost.record import Floats, Trace
from lndrl.navigation.training.replicas import RISK_ANGLE, RISK_STEPS

Kind = Literal["jump", "drift"]
Limit = Literal["distance", "angle", "both", "delay"]

JUMP_SHARE = 0.5
"""Of both limits: an estimate that was nearer than that one control step before has jumped. In one
step of 0.4 s the robot moves 0.24 m, so what is left cannot have been driven."""
TURNED_STEPS = 12
"""Control steps over which turning is summed: 4.8 s."""
BEFORE = 10
"""Control steps before the loss that are looked at."""
HEADING_STEPS = RISK_STEPS // 2
"""Control steps before a moment whose error of heading it is counted by: halfway through those for
which such an error is taken for a sign of loss."""
CELL = 2.0
"""m, side of the cells in which losses are counted by place."""

FIGURES = (
    "position_error",
    "angle_error",
    "particles",
    "slow_average",
    "fast_average",
    "ratio",
    "injected",
    "second_cluster",
)
"""What is told of a moment before a loss: m, rad, a number, two averages, fast over slow (NaN where
both have just been cleared), 1 where they have been (the step's last update let random particles in
by ROS's rule), a share of the weight."""

TURNED_EDGES = (0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0)  # rad
ECHO_EDGES = (0.2, 0.4, 0.6, 0.8)
PEOPLE_EDGES = (1, 2, 3, 5)
HEADING_EDGES = (0.02, 0.04, 0.06, 0.08, 0.1, 0.14, 0.2)  # rad
STEP_EDGES = (10, 20, 30, 40, 50, 60, 80)
RISKS = {
    "turned": TURNED_EDGES, "heading": HEADING_EDGES, "echoes": ECHO_EDGES,
    "people": PEOPLE_EDGES, "step": STEP_EDGES,
}  # fmt: skip
WHOLE = ("people", "step")
"""Those of ``RISKS`` that are counted in whole numbers."""
"""What the hazard is told by, with the edges between its bins."""


def turned(yaw: ArrayLike, steps: int = TURNED_STEPS) -> Floats:
    """Radians turned, left and right added up, in the last ``steps`` steps before every moment.

    ``yaw`` (T + 1,) rad; less than half a turn in a step. At the start it is 0.
    """
    change = np.diff(np.asarray(yaw, np.float64))
    way = np.concatenate([[0.0], np.cumsum(np.abs(_wrapped(change)))])
    begun = np.concatenate([np.zeros(min(steps, len(way))), way[:-steps]])
    return np.asarray(way - begun, np.float64)


def heading_before(trace: Trace, steps: int = HEADING_STEPS) -> Floats:
    """By how much (rad) the filter's heading erred ``steps`` steps before every moment, (T + 1,).

    Before the start it erred as at the start.
    """
    return _angle_error(trace, 0)[np.maximum(np.arange(len(trace.moments)) - steps, 0)]


def foretold(traces: Sequence[Trace]) -> float:
    """How many losses the errors of heading in all control steps of ``traces`` tell of.

    The chance that ``replicas.risk`` pays for: ``heading_risk``, of arrays.
    """
    errors = [_angle_error(trace, 0)[1:] for trace in traces]
    chance = np.minimum((np.concatenate(errors) / RISK_ANGLE) ** 3, 1.0) / RISK_STEPS
    return float(chance.sum())


def errors(trace: Trace) -> tuple[Floats, Floats]:
    """Position (m) and angle error (rad) of the filter's estimate at every moment, (T + 1,)."""
    return _position_error(trace, 0), _angle_error(trace, 0)


def _position_error(trace: Trace, delay: int) -> Floats:
    """Of the estimate that is ``delay`` steps old, against the truth of the moment."""
    last = len(trace.moments) - delay
    dx = trace.column("x")[delay:] - trace.column("x_estimated")[:last]
    dy = trace.column("y")[delay:] - trace.column("y_estimated")[:last]
    return np.hypot(dx, dy)


def _angle_error(trace: Trace, delay: int) -> Floats:
    last = len(trace.moments) - delay
    return np.abs(_wrapped(trace.column("yaw")[delay:] - trace.column("yaw_estimated")[:last]))


def _wrapped(angle: Floats) -> Floats:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi, np.float64)


@dataclass(frozen=True)
class Limits:
    """What ends an episode as lost: m, rad; a report is ``delay`` control steps old when heard."""

    distance: float
    angle: float
    delay: int = 0

    def passed(self, position_error: float, angle_error: float) -> Limit | None:
        """Which of them the errors pass."""
        far, turned_away = position_error > self.distance, angle_error > self.angle
        if far and turned_away:
            return "both"
        return "distance" if far else "angle" if turned_away else None


@dataclass(frozen=True)
class Loss:
    """One lost episode.

    ``moment`` is the control step whose report ended it, ``steps`` the one in which it ended:
    ``localization.delay`` later. ``limit`` is what that report had passed; "delay": neither, and
    only the truth, which had moved on meanwhile, was too far from it. Errors are those of the
    report, and of the one before; ``x, y`` is where the robot was, ``x_estimated, y_estimated``
    where it thought to be (m).
    """

    scenario: str
    episode: int
    steps: int
    moment: int
    kind: Kind
    limit: Limit
    x: float
    y: float
    x_estimated: float
    y_estimated: float
    position_error: float
    angle_error: float
    position_error_before: float
    angle_error_before: float


def moment_of_loss(trace: Trace, limits: Limits) -> int:
    """The control step whose report ended a lost ``trace``.

    The first of those that can have been heard last, which passes a limit by itself; where none
    does, the one that was heard.
    """
    position_error, angle_error = errors(trace)
    heard = max(trace.steps - limits.delay, 0)
    for moment in range(heard, trace.steps + 1):
        if limits.passed(position_error[moment], angle_error[moment]):
            return moment
    return heard


def loss_of(trace: Trace, limits: Limits) -> Loss:
    """How ``trace``, which ended lost, did so."""
    position_error, angle_error = errors(trace)
    moment = moment_of_loss(trace, limits)
    before = max(moment - 1, 0)
    was_near = (
        position_error[before] < JUMP_SHARE * limits.distance
        and angle_error[before] < JUMP_SHARE * limits.angle
    )
    return Loss(
        scenario=trace.scenario,
        episode=trace.episode,
        steps=trace.steps,
        moment=moment,
        kind="jump" if was_near else "drift",
        limit=limits.passed(position_error[moment], angle_error[moment]) or "delay",
        x=float(trace.column("x")[moment]),
        y=float(trace.column("y")[moment]),
        x_estimated=float(trace.column("x_estimated")[moment]),
        y_estimated=float(trace.column("y_estimated")[moment]),
        position_error=float(position_error[moment]),
        angle_error=float(angle_error[moment]),
        position_error_before=float(position_error[before]),
        angle_error_before=float(angle_error[before]),
    )


def figures_of(trace: Trace) -> Floats:
    """``FIGURES`` at every moment, (T + 1, figures)."""
    slow, fast = trace.column("slow_average"), trace.column("fast_average")
    ratio = np.full(len(slow), np.nan)
    np.divide(fast, slow, out=ratio, where=slow > 0.0)
    # Before the first update they are 0 as well.
    injected = ((slow == 0.0) & np.logical_or.accumulate(slow > 0.0)).astype(np.float64)
    columns = (*errors(trace), trace.column("particles"), slow, fast, ratio, injected)
    return np.stack([*columns, trace.column("second_cluster")], axis=1)


def before_losses(traces: Sequence[Trace], limits: Limits) -> Floats:
    """``FIGURES`` in the last steps of every lost trace: (losses, BEFORE + 1, figures).

    The last of the steps is the loss; NaN where an episode had not begun yet.
    """
    lost = [trace for trace in traces if trace.is_lost]
    found = np.full((len(lost), BEFORE + 1, len(FIGURES)), np.nan)
    for row, trace in enumerate(lost):
        until = moment_of_loss(trace, limits) + 1
        last = figures_of(trace)[max(until - BEFORE - 1, 0) : until]
        found[row, BEFORE + 1 - len(last) :] = last
    return found


class Typical(NamedTuple):
    """Median, quartiles and mean; NaN where there is nothing."""

    low: float
    median: float
    high: float
    mean: float


def typical(values: Floats) -> list[Typical]:
    """Of every column of ``values`` (n, columns); NaN is left out."""
    found = []
    for column in values.T:
        known = column[np.isfinite(column)]
        if len(known):
            low, median, high = (float(q) for q in np.percentile(known, (25, 50, 75)))
            found.append(Typical(low, median, high, float(known.mean())))
        else:
            found.append(Typical(np.nan, np.nan, np.nan, np.nan))
    return found


def usual_figures(traces: Sequence[Trace]) -> tuple[list[Typical], int]:
    """``FIGURES`` over all control steps of the episodes that were not lost, and how many."""
    kept = [figures_of(trace)[1:] for trace in traces if not trace.is_lost]
    pooled = np.concatenate([np.zeros((0, len(FIGURES))), *kept])
    return typical(pooled), len(pooled)


class Exposure(NamedTuple):
    """Every control step of all episodes, (n,) each: what was risked, and whether it went wrong.

    A step counts with the moment that the report judged in it describes.
    """

    place: NDArray[np.int64]  # index of the scenario
    x: Floats  # m
    y: Floats  # m
    turned: Floats  # rad
    heading: Floats  # rad, error of the estimate some steps before
    echoes: Floats  # share
    people: Floats
    step: Floats  # control steps since the start of the episode
    lost: NDArray[np.bool_]


def exposure_of(traces: Sequence[Trace], scenarios: Sequence[str], limits: Limits) -> Exposure:
    """The control steps of ``traces``; ``place`` counts ``scenarios``."""
    columns: list[list[NDArray[np.generic]]] = []
    for trace in traces:
        moments = np.maximum(np.arange(1, trace.steps + 1) - limits.delay, 0)
        lost = np.zeros(trace.steps, np.bool_)
        if trace.is_lost:
            lost[-1] = True
            moments[-1] = moment_of_loss(trace, limits)
        place = np.full(trace.steps, scenarios.index(trace.scenario))
        values = (
            trace.column("x"), trace.column("y"), turned(trace.column("yaw")),
            heading_before(trace), trace.column("echoes"), trace.column("people"),
            np.arange(trace.steps + 1.0),
        )  # fmt: skip
        columns.append([place, *(value[moments] for value in values), lost])
    return Exposure(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def hazards(values: Floats, lost: NDArray[np.bool_], edges: Sequence[float]) -> list[Hazard]:
    """The hazard in each of the bins that ``edges`` part: below the first, ..., from the last on.

    ``values`` (n,) and ``lost`` (n,) are one entry for every control step.
    """
    bins = np.searchsorted(np.asarray(edges), values, side="right")
    count = len(edges) + 1
    steps = np.bincount(bins, minlength=count)
    events = np.bincount(bins[lost], minlength=count)
    return [Hazard(int(k), int(n)) for n, k in zip(steps, events, strict=True)]


@dataclass(frozen=True)
class Cell:
    """A square of ``CELL`` m, its lower left corner at (``x``, ``y``) m."""

    x: float
    y: float
    hazard: Hazard


def cells_of(exposure: Exposure, place: int) -> list[Cell]:
    """The squares of scenario ``place`` in which the robot was, by x and y."""
    here = exposure.place == place
    corners = np.floor(np.stack([exposure.x[here], exposure.y[here]], axis=1) / CELL)
    found, of = np.unique(corners, axis=0, return_inverse=True)
    steps = np.bincount(of.reshape(-1), minlength=len(found))
    events = np.bincount(of.reshape(-1)[exposure.lost[here]], minlength=len(found))
    return [
        Cell(float(x) * CELL, float(y) * CELL, Hazard(int(k), int(n)))
        for (x, y), n, k in zip(found, steps, events, strict=True)
    ]
