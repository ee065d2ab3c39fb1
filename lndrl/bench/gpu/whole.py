"""Whole trainings: steps per second with and without CUDA graphs, and how soon one arrives."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lndrl.bench import train
from lndrl.bench.gpu.parts import Attempts, Tell
from lndrl.bench.gpu.plan import WAYS, Plan
from lndrl.bench.training import CONFIG, SETTINGS, WARM_UPDATES, Rows, Training, span
from lndrl.config import REPOSITORY_CONFIGS
from lndrl.errors import UserError
from lndrl.wording import counted

_LEAST_UPDATES = 4
_LEAVING = 10.0  # s that a run may take to end: nobody needs its last checkpoint
_LOOK = 0.2  # s


def rates(tell: Tell, deadline: float, plan: Plan) -> None:
    """The figures of ``bench train``, without graphs and with them, one run after the other.

    ``plan.actors`` actors; what is timed begins when all of them are there. Raises UserError at the
    end where one of the two could not be measured.
    """
    attempts = Attempts(tell)
    for number, (way, graphs) in enumerate(WAYS.items()):
        with attempts.one(way):
            left = (deadline - time.monotonic()) / (len(WAYS) - number)
            setting = f"learner.cuda_graphs={str(graphs).lower()}"
            tell(_rate(plan, setting, time.monotonic() + left - _LEAVING), way)
    attempts.settle()


def arrivals(tell: Tell, deadline: float, plan: Plan) -> None:
    """Train ``lndrl`` until a validated share of arrivals is ``plan.target``, or ``deadline``.

    Tells the ``curve`` so far, a point [minutes, steps, share] per validated version; whether the
    target was ``reached``, and then with how many ``steps`` and ``minutes`` of training, and how
    many ``minutes_until_known`` since the command. Raises UserError where nothing was validated.
    """
    began = time.monotonic()
    until = deadline - _LEAVING
    curve: list[list[float]] = []
    name = REPOSITORY_CONFIGS / "lndrl.yaml"
    with _training(plan, [], name, plan.validation) as training:

        def done(rows: Rows) -> bool:
            for row in training.curve()[len(curve) :]:
                sampled = row["sampled"]
                share = sampled["arrived"] / sampled["episodes"]
                curve.append([row["elapsed"] / 60.0, row["steps"], share])
                tell(list(curve), "curve")
            return _reached(curve, plan.target) is not None or time.monotonic() > until

        rows = training.wait(done, _LOOK)
        known = time.monotonic() - began
    if len(rows) >= _LEAST_UPDATES:
        tell((rows[-1]["steps"] - rows[0]["steps"]) / span(rows), "steps_per_second")
    point = _reached(curve, plan.target)
    tell(plan.target, "target")
    tell(point is not None, "reached")
    if point is not None:
        tell(point[0], "minutes")
        tell(point[1], "steps")
        tell(known / 60.0, "minutes_until_known")
    if not curve:
        raise UserError(f"nothing was validated in {known:.0f} s, {counted(len(rows), 'update')}")


def _reached(curve: Sequence[Sequence[float]], target: float) -> Sequence[float] | None:
    """The first point that has the target."""
    return next((point for point in curve if point[2] >= target), None)


def _rate(plan: Plan, setting: str, until: float) -> dict[str, Any]:
    began = time.monotonic()
    more = ["--actors", str(plan.actors)]

    def done(rows: Rows) -> bool:
        timed = settled(rows, plan.actors)
        enough = len(timed) > _LEAST_UPDATES and span(timed) >= plan.timed
        return enough or time.monotonic() > until

    with _training(plan, more, CONFIG, [*SETTINGS, setting]) as training:
        rows = training.wait(done, _LOOK)
    # With fewer actors than asked for it is a figure, too: of as many as it says.
    timed = settled(rows, plan.actors)
    if len(timed) <= _LEAST_UPDATES:
        timed = rows[WARM_UPDATES - 1 :]
    if len(timed) < 2:
        took = time.monotonic() - began
        raise UserError(f"{counted(len(rows), 'update')} in {took:.0f} s: too few for a figure")
    return train.figures(timed)


def settled(rows: Rows, actors: int) -> Rows:
    """The rows from where all ``actors`` are there, warm updates left out."""
    for first in range(WARM_UPDATES - 1, len(rows)):
        if rows[first]["time"]["actors"] >= actors:
            return rows[first:]
    return []


@contextmanager
def _training(
    plan: Plan, more: Sequence[str], config: Path, settings: Sequence[str]
) -> Iterator[Training]:
    """A run in a folder of its own, which is gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="lndrl-bench-") as folder:
        options = ["--device", plan.device, *more]
        everything = [*plan.settings, *settings]
        with Training(
            "bench gpu", Path(folder), "tcp", options, config, everything, _LEAVING
        ) as training:
            yield training
