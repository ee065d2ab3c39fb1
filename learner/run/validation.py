"""Validation on the learner's side: which weights are tested, what came of it, which were best.

Evaluators ask and report on a thread of the transport. There results are only checked and put
down; the learner's own thread records them, so nothing of this can disturb an update.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Lock
from typing import Any

from learner.run.best import read_best, save_best, set_aside_best
from learner.run.events import EventLog
from learner.run.record import Recorder
from lndrl.config import RunConfig
from lndrl.curve import Standstill, conditions, score, standstill
from lndrl.transport import (
    PROTOCOL_VERSION,
    Ack,
    EvaluatorHello,
    Refusal,
    ValidationResult,
    ValidationTask,
)
from lndrl.version import VERSION
from lndrl.wilson import wilson_interval

SHOWN = 120
"""Points of the curve that a status carries."""
LAST_ROUND = 180.0
"""s that a run's end is put off for the result of its last weights, at most."""
_SILENT = 10.0  # s without a word after which an evaluator that has nothing to do is gone
_LOOK = 0.2  # s
_EVALUATORS = 16  # whose names are kept; one more takes the place of the oldest
_MOST_HELD = 2  # versions of 30 MB each that evaluators are at; one more waits for its turn
_GIVEN_UP = 600.0  # s after which what one evaluator has may be tested by another, or forgotten


@dataclass(frozen=True)
class _Offer:
    """Weights as they were published; ``elapsed`` s of training came before."""

    version: int
    steps: int
    elapsed: float
    weights: bytes


@dataclass(frozen=True)
class _Handed:
    """An offer that an evaluator has, since ``at`` (monotonic s), and no result of it yet."""

    offer: _Offer
    at: float


class Validation:
    """What evaluators may test, and the curve of what they found; see ``ValidationHandlers``.

    ``curve`` holds a row per validated version, in the order in which the results came;
    ``standstill`` says that it no longer rises, which finishes the run.
    """

    def __init__(
        self, config: RunConfig, run_id: str, incarnation: str, folder: Path, events: EventLog
    ) -> None:
        """``folder``: of the checkpoints."""
        self.episodes = config.learner.validation_episodes
        self.curve: list[dict[str, Any]] = []
        self.best: dict[str, Any] | None = None
        self.standstill: Standstill | None = None
        self._config, self._folder, self._events = config, folder, events
        self._config_data = config.model_dump(mode="json")
        self._run_id, self._incarnation = run_id, incarnation
        self._under = conditions(config)
        self._newest: _Offer | None = None
        self._handed: dict[str, _Handed] = {}  # by evaluator
        self._lives: dict[str, str] = {}  # evaluator to incarnation
        self._done: set[int] = set()  # versions of which there is a result
        self._waiting: deque[tuple[ValidationResult, _Offer]] = deque()
        self._heard: float | None = None  # monotonic s of an evaluator's newest word
        self._last = False  # nothing newer will come
        self._lock = Lock()

    # -- the learner's side ------------------------------------------------------------------

    def take_up(self, curve: list[dict[str, Any]], went_back_to: int | None) -> None:
        """Go on with the curve of earlier sessions and the best policy that they left.

        ``went_back_to``: the step that the run goes on from, where later checkpoints were set
        aside for it. A best policy that is no measure for what comes is set aside, too.
        """
        self.curve = curve
        self._done = {row["version"] for row in curve}
        self._look_for_standstill()
        try:
            best = read_best(self._folder)
        except ValueError as error:
            set_aside_best(self._folder)
            self._events.add("checkpoint", f"best is damaged ({error}) and set aside")
            return
        if best is None:
            return
        why = ""
        if went_back_to is not None and best["steps"] > went_back_to:
            why = "the run goes on before it"
        elif best["under"] != self._under:
            why = "validation is of other episodes now"
        if why:
            set_aside_best(self._folder)
            self._events.add("checkpoint", f"best (step {best['steps']:,}) is set aside: {why}")
        else:
            self.best = best

    def offer(self, version: int, steps: int, elapsed: float, weights: bytes) -> None:
        """These are the newest weights, which are published already."""
        if self.episodes:
            with self._lock:
                self._newest = _Offer(version, steps, elapsed, weights)

    def turn(self, recorder: Recorder, updates: int) -> None:
        """Record the results that have come, after so many updates; never raises."""
        while self._waiting:
            result, offer = self._waiting.popleft()
            row = self._row(result, offer)
            score = self._score(row)
            better = self.best is None or score >= self.best["score"]
            self.curve.append(row)
            recorder.add_validation(row, updates)
            if better:
                self._keep(offer, {**row, "score": score})
            self._events.add("validated", f"at step {offer.steps:,}: {in_words(row)}")
            self._look_for_standstill()

    def finish(self, recorder: Recorder, updates: int, stop: Event) -> None:
        """Wait for the result of the newest weights, which are the run's last, and record it.

        Evaluators get them without resting before. Nobody waits where no evaluator is, longer than
        LAST_ROUND s (for one that vanished in mid-round), or once ``stop`` is set.
        """
        self._last = True
        end = time.monotonic() + LAST_ROUND
        if self._hoped_for():
            text = "waiting for that of the last weights; Ctrl-C does without"
            self._events.add("validation", text)
        while self._hoped_for() and time.monotonic() < end and not stop.is_set():
            stop.wait(_LOOK)
            self.turn(recorder, updates)

    def _hoped_for(self) -> bool:
        """Whether a result of the newest weights may come yet."""
        now = time.monotonic()
        with self._lock:
            if self._newest is None or self._newest.version in self._done:
                return bool(self._waiting)
            at_work = any(now - handed.at < _GIVEN_UP for handed in self._handed.values())
            return at_work or (self._heard is not None and now - self._heard < _SILENT)

    def snapshot(self) -> dict[str, Any] | None:
        """For the status; None where the run validates nothing."""
        if not self.episodes and not self.curve:
            return None
        names = ("version", "steps", "unix", "sampled", "greedy")
        heard, best = self._heard, self.best
        return {
            "episodes": self.episodes,
            "heard": None if heard is None else time.monotonic() - heard,
            "points": [{name: row[name] for name in names} for row in self.curve[-SHOWN:]],
            "best": {name: best[name] for name in names} if best is not None else None,
        }

    def _look_for_standstill(self) -> None:
        self.standstill = standstill(self.curve, self._config, self._under)

    def _row(self, result: ValidationResult, offer: _Offer) -> dict[str, Any]:
        return {
            "version": offer.version,
            "steps": offer.steps,
            "elapsed": offer.elapsed,
            "unix": time.time(),
            "seconds": result.seconds,
            "evaluator": result.evaluator_id,
            "under": self._under,
            "sampled": dict(result.sampled),
            "greedy": dict(result.greedy),
        }

    def _score(self, row: dict[str, Any]) -> float:
        """See ``score``; the neighbour is the nearest version before that is known by now."""
        before = [
            other
            for other in self.curve
            if other["version"] < row["version"] and other["under"] == row["under"]
        ]
        return score(row, max(before, key=lambda other: other["version"], default=None))

    def _keep(self, offer: _Offer, facts: dict[str, Any]) -> None:
        try:
            save_best(self._folder, self._config, offer.weights, facts)
        except OSError as error:
            self._events.add("disk", f"best (step {offer.steps:,}) cannot be written: {error}")
            return
        self.best = facts

    # -- handlers, called on a transport's thread --------------------------------------------

    def on_evaluator(self, hello: EvaluatorHello) -> ValidationTask | Refusal:
        """Hand out the newest weights' version if nobody has tested it, or does so now."""
        if hello.protocol != PROTOCOL_VERSION or hello.program_version != VERSION:
            return Refusal(
                f"this learner is lndrl {VERSION} (protocol {PROTOCOL_VERSION}), the evaluator is "
                f"lndrl {hello.program_version[:40]} (protocol {hello.protocol}); install the same"
            )
        if not self.episodes:
            return Refusal(
                "this run validates nothing; train with --set learner.validation_episodes=100"
            )
        name = hello.evaluator_id
        with self._lock:
            self._heard = time.monotonic()
            joined = self._lives.get(name) != hello.incarnation
            if joined:
                self._lives[name] = hello.incarnation
                while len(self._lives) > _EVALUATORS:
                    self._lives.pop(next(iter(self._lives)))
            offer = self._hand(name) if hello.ready or self._last else None
        if joined:
            self._events.add("join", f"evaluator {name} on {hello.host[:80]}", sender=name)
        if offer is None:
            return ValidationTask(self._run_id, self._config_data)
        return ValidationTask(self._run_id, self._config_data, offer.version)

    def on_validation(self, result: ValidationResult) -> Ack:
        """Take a result once, of weights that were handed out and episodes as they should be."""
        if result.run_id != self._run_id:
            return self._refuse(result, f"run {result.run_id[:80]} is not this run")
        if result.learner_incarnation != self._incarnation:
            return Ack("stale", reason="the weights were those of another learner")
        limit = self._config.steps_limit
        for counts in (result.sampled, result.greedy):
            if counts["episodes"] != self.episodes:
                return self._refuse(result, f"{self.episodes} episodes are asked for")
            if counts["steps"] > counts["episodes"] * limit:
                return self._refuse(result, f"an episode has at most {limit:,} steps")
        with self._lock:
            self._heard = time.monotonic()
            if result.version in self._done:
                return Ack("duplicate")
            mine = self._handed.get(result.evaluator_id)
            if mine is None or mine.offer.version != result.version:
                return Ack("stale", reason=f"version {result.version} is no longer kept")
            del self._handed[result.evaluator_id]
            self._done.add(result.version)
            self._waiting.append((result, mine.offer))
        return Ack("accepted")

    def _hand(self, evaluator: str) -> _Offer | None:
        """The newest weights for ``evaluator``, None for now; what it had before is forgotten."""
        offer, now = self._newest, time.monotonic()
        if offer is None or offer.version in self._done:
            return None
        for name, handed in self._handed.items():
            if (
                name != evaluator
                and handed.offer.version == offer.version
                and now - handed.at < _GIVEN_UP
            ):
                return None
        self._handed.pop(evaluator, None)
        if len(self._handed) >= _MOST_HELD:
            # Were a version forgotten that somebody is at, three could keep all from counting.
            oldest = next(iter(self._handed))
            if now - self._handed[oldest].at < _GIVEN_UP:
                return None
            del self._handed[oldest]
        self._handed[evaluator] = _Handed(offer, now)
        return offer

    def _refuse(self, result: ValidationResult, reason: str) -> Ack:
        name = result.evaluator_id
        self._events.add("refused", f"validation by {name}: {reason}", sender=name)
        return Ack("refused", reason=reason)


def in_words(row: dict[str, Any]) -> str:
    """How the episodes of a row ended: shares, and 95 % Wilson intervals of the arrivals."""
    sampled, greedy = row["sampled"], row["greedy"]
    rest = ", ".join(
        f"{sampled[key] / sampled['episodes']:.2f} {word}"
        for key, word in (("collided", "collided"), ("lost", "lost"), ("timeout", "stuck"))
    )
    return f"{arrivals(sampled)} of {sampled['episodes']}, {rest}; greedy {arrivals(greedy)}"


def arrivals(counts: dict[str, int]) -> str:
    """For example ``0.93 arrived (0.86-0.97)``."""
    low, high = wilson_interval(counts["arrived"], counts["episodes"])
    return f"{counts['arrived'] / counts['episodes']:.2f} arrived ({low:.2f}-{high:.2f})"
