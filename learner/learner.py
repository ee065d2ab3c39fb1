"""The learner: collect a batch, update, publish, record, checkpoint; the whole loop is ``run``."""

from __future__ import annotations

import time
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from learner.batch import Batch, assemble
from learner.checkpoint import (
    Counters,
    find_checkpoint,
    load_checkpoint,
    save_checkpoint,
    start_from,
)
from learner.events import EventLog
from learner.folder import RunFolder
from learner.ingest import Chunk, Ingest
from learner.memory import keep_freed_memory
from learner.record import EpisodeWindow, Recorder, RunSummary
from learner.rollout_store import RolloutStore
from learner.roster import Roster
from learner.timing import TimeSplit
from learner.update import PPO, DivergedError
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.policy import to_bytes
from lndrl.transport import LearnerEndpoint
from lndrl.transport.status import LEARNER_ACTIVITIES, overhead


class Learner:
    """One training run, from its start or from a checkpoint.

    Args:
        config: the resolved configuration.
        path: the run's folder; must not exist unless ``resume``.
        endpoint: the open transport.
        resume: go on from a checkpoint of ``path``.
        checkpoint: which one; the newest by default.

    Raises UserError when the folder or the checkpoint cannot be used.
    """

    def __init__(
        self,
        config: RunConfig,
        path: Path,
        endpoint: LearnerEndpoint,
        resume: bool = False,
        checkpoint: str | None = None,
        quiet: bool = False,
    ) -> None:
        keep_freed_memory()
        self.config = config
        self.endpoint = endpoint
        self.ppo = PPO(config)
        self.store = RolloutStore(pinned=self.ppo.device.type == "cuda")
        self.roster = Roster()
        self.counters = Counters()
        begin = "from scratch"
        if resume:
            chosen = find_checkpoint(path / "checkpoints", checkpoint)
            self.counters, roster = load_checkpoint(chosen, self.ppo)
            self.roster.restore(roster)
        elif config.learner.start is not None:
            begin = f"from the networks of {start_from(Path(config.learner.start), self.ppo)}"
        self.folder = (RunFolder.open if resume else RunFolder.create)(path, config)
        self.events = EventLog(self.folder.events, quiet)
        self.ingest = Ingest(
            config, self.folder.run_id, endpoint.incarnation, self.roster, self.events
        )
        self.episodes = EpisodeWindow(self.counters.episodes)
        self.recorder = Recorder(self.folder.path, self.counters.updates)
        self.split = TimeSplit(LEARNER_ACTIVITIES)
        self.figures: dict[str, float] = {}
        self.lag: dict[str, float] = {}
        self.history: list[dict[str, Any]] = []
        self.last_checkpoint: tuple[Path, float] | None = None
        self.started = time.monotonic()
        self._elapsed_before = self.counters.elapsed
        where = f"from step {self.counters.steps:,}" if resume else begin
        self.events.add("start", f"run {self.folder.run_id} {where}")

    # -- the loop ----------------------------------------------------------------------------

    def run(self, stop: Event) -> None:
        """Train until the configured number of steps, or until ``stop`` is set."""
        self.begin()
        while not self.finished and not stop.is_set():
            self.advance(timeout=0.2)
        self.end()

    def begin(self) -> None:
        """Open the door to actors and offer them weights."""
        if self.last_checkpoint is None and not self.counters.updates:
            self.checkpoint()  # a learner that dies early can be resumed, too
        self.ingest.weights_version = self.counters.version
        self.endpoint.start(self.ingest)
        self._publish()

    def advance(self, timeout: float) -> bool:
        """One update if a batch comes within ``timeout`` s; whether it did."""
        with self.split.during("wait"):
            chunks = self._collect(timeout)
        if chunks is None:
            return False
        began = time.monotonic()
        with self.split.during("ingest"):
            batch = assemble([chunk.trajectory for chunk in chunks], self.store)
        with self.split.during("update"):
            self._update(batch)
        with self.split.during("publish"):
            self._publish()
        self._record(chunks, time.monotonic() - began)
        if self.finished or self.counters.updates % self.config.learner.checkpoint_interval == 0:
            self.checkpoint()
        return True

    def end(self) -> None:
        """Leave a checkpoint and say goodbye; the endpoint stays open for last answers."""
        if self.counters.updates and (
            self.last_checkpoint is None
            or self.last_checkpoint[0].name != f"step-{self.counters.steps:09d}"
        ):
            self.checkpoint()
        if self.finished:
            self.ingest.finish()
            self.endpoint.finish()
        self.folder.write_summary(self.summary().to_dict())
        word = "finished" if self.finished else "stopped"
        self.events.add("end", f"{word} at step {self.counters.steps:,}")

    def close(self) -> None:
        """Release threads and files; the endpoint belongs to whoever opened it."""
        self.ppo.close()
        self.recorder.close()

    # -- steps of the loop -------------------------------------------------------------------

    def _collect(self, timeout: float) -> list[Chunk] | None:
        if self.config.learner.mode == "lockstep":
            return self.ingest.take_round(self.config.fixed_actors, timeout)
        return self.ingest.take(self.config.ppo.batch_size, timeout)

    def _update(self, batch: Batch) -> None:
        lag = np.maximum(self.counters.version - batch.version, 0)
        progress = min(1.0, self.counters.steps / self.config.learner.total_steps)
        try:
            self.figures = self.ppo.update(batch, progress)
        except DivergedError as error:
            newest = self.last_checkpoint
            kept = f"the checkpoint {newest[0].name} is intact" if newest else "none was saved"
            self.events.add("diverged", str(error))
            raise UserError(
                f"training diverged at update {self.counters.updates + 1} ({error}); {kept}, "
                "resume with a lower learning rate"
            ) from None
        self.lag = {"mean": float(lag.mean()), "max": int(lag.max())}
        self.counters.steps += len(batch)
        self.counters.updates += 1

    def _publish(self) -> None:
        """Offer the current weights under the next version."""
        if self.counters.updates:
            self.counters.version = self.counters.updates
        self.ingest.weights_version = self.counters.version
        self.endpoint.publish_weights(self.counters.version, to_bytes(self.ppo.policy))

    def _record(self, chunks: list[Chunk], seconds: float) -> None:
        for chunk in chunks:
            self.episodes.add(chunk.episodes)
        self.counters.episodes = self.episodes.count
        self.counters.elapsed = self.elapsed
        shares, actors = self.split.shares(), self.roster.shares()
        row = {
            "update": self.counters.updates,
            "steps": self.counters.steps,
            "version": self.counters.version,
            "samples": sum(chunk.samples for chunk in chunks),
            "episodes": self.episodes.figures(),
            "reward_parts": self.episodes.reward_parts(),
            "ppo": self.figures,
            "lag": self.lag,
            "time": {
                "unix": time.time(),
                "elapsed": self.elapsed,
                "update": seconds,
                "steps_per_second": self.ingest.rates.rate(60.0),
                "actors": self.roster.counts()[0],
                **{f"share_{name}": share for name, share in shares.items()},
                **{f"actor_share_{name}": share for name, share in actors.items()},
                "overhead_learner": overhead(shares),
                "overhead_actor": overhead(actors),
                # Sums since this learner started: what lies between two rows is exact.
                "spent": {
                    "learner": self.split.totals(),
                    "actors": self.roster.totals(),
                    "actor_steps": self.roster.steps(),
                },
            },
        }
        self.recorder.add(row)
        self.history.append(_history_row(row))
        del self.history[:-600]

    def checkpoint(self) -> None:
        """Write a checkpoint; a disk that refuses is reported and training goes on."""
        with self.split.during("checkpoint"):
            try:
                path = save_checkpoint(
                    self.folder.checkpoints,
                    self.ppo,
                    self.counters,
                    self.roster.to_state(),
                    self.config.learner.keep_checkpoints,
                )
            except OSError as error:
                self.events.add("disk", f"no checkpoint at step {self.counters.steps:,}: {error}")
                return
        self.last_checkpoint = (path, time.time())
        self.events.add("checkpoint", path.name)

    # -- what others may ask -----------------------------------------------------------------

    @property
    def finished(self) -> bool:
        """Whether the configured number of steps is reached."""
        return self.counters.steps >= self.config.learner.total_steps

    @property
    def elapsed(self) -> float:
        """Seconds of training over all sessions of the run."""
        return self._elapsed_before + time.monotonic() - self.started

    def summary(self) -> RunSummary:
        """How the run stands."""
        return RunSummary(
            folder=self.folder.path,
            finished=self.finished,
            steps=self.counters.steps,
            updates=self.counters.updates,
            seconds=self.elapsed,
            episodes=self.episodes.figures(),
            dropped=dict(self.ingest.dropped),
            checkpoint=self.last_checkpoint[0] if self.last_checkpoint else None,
        )


def _history_row(row: dict[str, Any]) -> dict[str, Any]:
    episodes = row["episodes"]
    names = ("arrived", "collided", "lost", "timeout", "mean_return")
    return {
        "time": row["time"]["unix"],
        "steps": row["steps"],
        "rate": row["time"]["steps_per_second"],
        **{name: episodes[name] for name in names},
        "kl": row["ppo"].get("kl"),
        "entropy": row["ppo"].get("entropy"),
        "lag": row["lag"]["mean"],
    }
