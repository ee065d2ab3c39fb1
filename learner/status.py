"""The learner's condition as a snapshot for dashboards, and its judgement in words."""

from __future__ import annotations

import socket
import time
from threading import Event, Thread
from typing import Any

from learner.learner import Learner
from lndrl import kernels
from lndrl.transport.status import balance_word, overhead
from lndrl.version import VERSION

_SETTLING = 5.0  # s from the first update on, before which shares of time say little


def snapshot(learner: Learner) -> dict[str, Any]:
    """What ``lndrl.transport.status.Status`` describes, as plain data."""
    whole, counters, config = learner.whole, learner.counters, learner.config
    rates = whole.rates()
    shares = learner.split.shares()
    actors = whole.rows(counters.version)
    actor_shares = whole.actor_shares()
    left = max(0, config.learner.total_steps - counters.steps)
    kept = learner.last_checkpoint
    stage = learner.stage
    return {
        "run_id": learner.folder.run_id,
        "run_name": learner.folder.path.name,
        "program_version": VERSION,
        "verdict": _verdict(learner, actors),
        "state": "done" if learner.finished else ("training" if counters.updates else "waiting"),
        "phase": stage.phase if config.ppo.teacher is not None else "",
        "phase_until": stage.until,
        "time": max(0.0, time.time()),
        "uptime": time.monotonic() - learner.started,
        "steps": counters.steps,
        "total_steps": config.learner.total_steps,
        "updates": counters.updates,
        "weights_version": counters.version,
        "rate": rates,
        "eta": left / rates["300s"] if rates["300s"] > 0 else None,
        "time_split": shares,
        "actor_split": actor_shares,
        "overhead_learner": overhead(shares),
        "overhead_actor": overhead(actor_shares),
        "actors": actors,
        "episodes": learner.episodes.figures(),
        "ppo": learner.figures,
        "lag": {**learner.lag, "shares": learner.lag_shares},
        "host": socket.gethostname(),
        "machine": learner.load.now(),
        "dropped": whole.dropped(),
        "accounts": whole.accounts(),
        "queue": whole.waiting(),
        "validation": learner.validation.snapshot(),
        "session": learner.session.figures(),
        "traffic": whole.traffic(learner.endpoint.traffic.counts()),
        "events": learner.events.recent(),
        "checkpoint": {"path": str(kept[0]), "age": time.monotonic() - kept[1]} if kept else None,
    }


def _verdict(learner: Learner, actors: list[dict[str, Any]]) -> str:
    if learner.finished:
        return f"done: {learner.early}" if learner.early else "done"
    if all(actor["state"] == "gone" for actor in actors):
        return "waiting for actors"
    if sentence := _compiling(learner, actors):
        return f"compiling: {sentence}"
    # That the learner waited for the first batch of all says nothing about the balance.
    first = learner.first_update
    since = time.monotonic() - first if first is not None else 0.0
    if since < _SETTLING:
        return "learning"
    waits = learner.split.shares(since)["wait"]
    return balance_word(waits, learner.whole.actor_shares(since).get("wait", 0.0))


def _compiling(learner: Learner, actors: list[dict[str, Any]]) -> str:
    """How far kernels are where the run waits for them, as it does on a machine's first start."""
    own = kernels.in_progress()
    waiting = [a for a in actors if a["state"] != "gone" and a["kernels_needed"]]
    if learner.first_update is not None:
        waiting = []
    # All count what is ready on their machine, and whoever needs the most tells the most.
    known = [(a["kernels_needed"], a["kernels_ready"], str(a["id"])) for a in waiting]
    if own is not None:
        known.append((own[1], own[0], "the learner"))
    if not known:
        return ""
    needed, ready, first = max(known)
    others = f" and {len(known) - 1} more" if len(known) > 1 else ""
    who = f"on {first}{others}" if waiting else "in the learner"
    return f"{ready} of {needed} kernels are ready {who}; only a first start takes that long"


class StatusThread:
    """Publishes a snapshot every ``interval`` seconds until stopped; never disturbs training."""

    def __init__(self, learner: Learner, interval: float = 1.0) -> None:
        self._learner = learner
        self._interval = interval
        self.newest: dict[str, Any] | None = None  # replaced, never changed
        self._stop = Event()
        self._thread = Thread(target=self._run, name="status", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Publish once more and end."""
        self._stop.set()
        self._thread.join(timeout=5.0)
        self._publish()

    def _run(self) -> None:
        while not self._stop.wait(self._interval):
            self._publish()

    def _publish(self) -> None:
        self.newest = now = snapshot(self._learner)
        self._learner.endpoint.publish_status(now, list(self._learner.history))
