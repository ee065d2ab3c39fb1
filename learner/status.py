"""The learner's condition as a snapshot for dashboards, and its judgement in words."""

from __future__ import annotations

import time
from threading import Event, Thread
from typing import Any

from learner.learner import Learner


def snapshot(learner: Learner) -> dict[str, Any]:
    """What ``lndrl.transport.status.Status`` describes, as plain data."""
    ingest, counters, config = learner.ingest, learner.counters, learner.config
    rates = ingest.rates.all()
    shares = learner.split.shares()
    actors = learner.roster.rows(counters.version)
    left = max(0, config.learner.total_steps - counters.steps)
    now = time.time()
    kept = learner.last_checkpoint
    return {
        "run_id": learner.folder.run_id,
        "run_name": learner.folder.path.name,
        "verdict": _verdict(learner.finished, shares, actors),
        "state": "done" if learner.finished else ("training" if counters.updates else "waiting"),
        "time": now,
        "uptime": time.monotonic() - learner.started,
        "steps": counters.steps,
        "total_steps": config.learner.total_steps,
        "updates": counters.updates,
        "weights_version": counters.version,
        "rate": rates,
        "eta": left / rates["300s"] if rates["300s"] > 0 else None,
        "time_split": shares,
        "actors": actors,
        "episodes": learner.episodes.figures(),
        "ppo": learner.figures,
        "lag": learner.lag,
        "dropped": dict(ingest.dropped),
        "queue": ingest.waiting(),
        "events": learner.events.recent(),
        "checkpoint": {"path": str(kept[0]), "age": now - kept[1]} if kept else None,
    }


def _verdict(finished: bool, shares: dict[str, float], actors: list[dict[str, Any]]) -> str:
    living = [actor for actor in actors if actor["state"] != "gone"]
    if finished:
        return "done"
    if not living:
        return "waiting for actors"
    if shares["wait"] > 0.5:
        return "actor-bound"
    idle = sum(actor["time_split"].get("upload", 0.0) for actor in living) / len(living)
    if shares["wait"] < 0.05 and idle > 0.3:
        return "learner-bound"
    return "learning"


class StatusThread:
    """Publishes a snapshot every ``interval`` seconds until stopped; never disturbs training."""

    def __init__(self, learner: Learner, interval: float = 1.0) -> None:
        self._learner = learner
        self._interval = interval
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
        self._learner.endpoint.publish_status(snapshot(self._learner), list(self._learner.history))
