"""``lndrl bench tls``: what mutual TLS costs a whole training.

Two runs live side by side, one over plain TCP and one over TLS, and only one of them goes on at a
time: the other is stopped, process group and all. Turns are short, because a shared machine changes
its speed within minutes, and whole updates, because each of them carries the weights once.
"""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from lndrl.bench.training import CONFIG, WARM_UPDATES, Rows, Training, span
from lndrl.config import load_config
from lndrl.transport.security.certificates import create

_TURN = 10.0  # s at least
_LEAST_TURNS = 2  # of each run
_LOOK = 0.05  # s
_PATIENCE = 3600.0  # s; a run that stands still while the other goes on must not seem dead

_BLOCK = {"wait_before_close": int(1e6 * _PATIENCE)}
_WAITING = {"transport": {"link": {"tx": {"queue": {"congestion_control": {"block": _BLOCK}}}}}}
"""zenoh's settings: weights may be half sent when a run is stopped."""


@dataclass(frozen=True)
class Turn:
    """One turn of a run; ``seconds`` without those in which it was stopped."""

    run: str
    steps: int
    seconds: float

    @property
    def rate(self) -> float:
        """Steps per second."""
        return self.steps / self.seconds


def measure(seconds: float) -> dict[str, Any]:
    """``steps_per_second`` over ``plain`` TCP and over mutual ``tls``, and what TLS ``cost``.

    Runs ``lndrl train`` as ``bench train`` does, certificates as ``lndrl certs`` makes them, until
    both have had ``12 * seconds`` of turns. ``cost`` is 1 - tls / plain, of the medians of the
    turns; ``cost_of_pairs`` is the same of every two neighbouring turns: median, least and most.
    ``actors_lost`` counts actors that left and came again: they should not. Raises UserError when
    a run does not get going.
    """
    with tempfile.TemporaryDirectory(prefix="lndrl-bench-") as place, ExitStack() as stack:
        certificates = Path(place) / "certs"
        create(certificates, [])
        patience = Path(place) / "patience.json5"
        patience.write_text(json.dumps(_WAITING), encoding="utf-8")
        waits = ["--zenoh", str(patience)]
        runs = []
        for name, scheme, more in (
            ("plain", "tcp", []),
            ("tls", "tls", ["--certs", str(certificates)]),
        ):
            folder = Path(place) / name
            folder.mkdir()
            training = Training("bench tls", folder, scheme, [*_settings(), *waits, *more])
            runs.append(Paused(name, stack.enter_context(training)))
        turns = alternate(runs, 12.0 * seconds)
        lost = sum(run.lost() for run in runs)
    return figures(turns) | {"actors_lost": lost}


def alternate(runs: Sequence[Paused], seconds: float) -> list[Turn]:
    """One turn after the other until each run has had ``seconds``; the first run also ends it.

    So every turn of the others has a neighbour on both sides, and a drift cancels.
    """
    turns: list[Turn] = []
    while True:
        for run in runs:
            turns.append(run.turn(_TURN))
            mine = [[t.seconds for t in turns if t.run == other.name] for other in runs]
            enough = min(map(sum, mine)) >= seconds and min(map(len, mine)) >= _LEAST_TURNS
            if enough and run is runs[0]:
                return turns


def figures(turns: Sequence[Turn]) -> dict[str, Any]:
    """The figures of ``measure`` from turns of ``plain`` and ``tls`` in the order they were."""
    rates = {
        name: statistics.median(turn.rate for turn in turns if turn.run == name)
        for name in ("plain", "tls")
    }
    costs = []
    for one, other in pairwise(turns):
        pair = {one.run: one.rate, other.run: other.rate}
        costs.append(1.0 - pair["tls"] / pair["plain"])
    return {
        "steps_per_second": rates,
        "cost": 1.0 - rates["tls"] / rates["plain"],
        "cost_of_pairs": {
            "median": statistics.median(costs),
            "least": min(costs),
            "most": max(costs),
        },
        "pairs": len(costs),
        "seconds": {
            name: sum(turn.seconds for turn in turns if turn.run == name) for name in rates
        },
    }


class Paused:
    """A training that stands still but for its turns. Warms up, then stops, when made."""

    def __init__(self, name: str, training: Training) -> None:
        self.name = name
        self._training = training
        self._rows = training.wait(lambda rows: len(rows) >= WARM_UPDATES, _LOOK)
        training.pause()
        self._paused = time.time()

    def turn(self, seconds: float) -> Turn:
        """Go on for whole updates that take ``seconds`` or more together, then stop again.

        What it did between its last row and the stop counts, the time of standing still does not.
        """
        last = len(self._rows) - 1
        stood = time.time() - self._paused

        def done(rows: Rows) -> bool:
            return len(rows) - 1 > last and span(rows[last:]) - stood >= seconds

        self._training.go_on()
        self._rows = self._training.wait(done, _LOOK)
        self._training.pause()
        self._paused = time.time()
        rows = self._rows[last:]
        return Turn(self.name, rows[-1]["steps"] - rows[0]["steps"], span(rows) - stood)

    def lost(self) -> int:
        """How often the learner saw an actor leave so far."""
        events = (self._training.folder / "events.log").read_text(
            errors="replace", encoding="utf-8"
        )
        return events.count(" leave ")


def _settings() -> list[str]:
    """Arguments under which a run does not notice that it stood still, and keeps its actors."""
    from actors.balance import first_choice
    from lndrl.machine.cores import usable_cores

    actors = first_choice(load_config(CONFIG), usable_cores()).actors
    waits = [f"transport.{key}={_PATIENCE:g}" for key in ("lease", "upload_timeout")]
    return ["--actors", str(actors), "--set", *waits]
