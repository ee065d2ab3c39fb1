"""The learner: collect a batch, update, publish, record, checkpoint; the whole loop is ``run``."""

from __future__ import annotations

import time
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from learner.intake.accounts import Accounts
from learner.intake.ingest import Chunk, Ingest
from learner.intake.ledger import Ledger
from learner.intake.limits import check_messages, check_queue
from learner.intake.roster import Roster
from learner.intake.whole import Whole
from learner.memory import MemoryTide, keep_freed_memory
from learner.ppo.batch import Batch, assemble
from learner.ppo.example.stage import Stage, stage_of
from learner.ppo.rollout_store import RolloutStore
from learner.ppo.schedules import batch_size
from learner.ppo.update import PPO, DivergedError
from learner.ranks.crew import Crew
from learner.rows import history_row, metrics_row
from learner.run.checkpoint import (
    Counters,
    clean_up,
    damaged,
    find_checkpoint,
    load_checkpoint,
    save_checkpoint,
    set_aside_later,
    start_from,
)
from learner.run.events import EventLog
from learner.run.folder import RunFolder
from learner.run.history import History
from learner.run.orders import Orders
from learner.run.record import EpisodeWindow, Recorder, RunSummary
from learner.run.validation import Validation
from learner.sending import Sender
from learner.session import Session
from learner.timing import TimeSplit
from lndrl.config import RunConfig
from lndrl.curve import read_curve
from lndrl.errors import UserError
from lndrl.machine.load import Load
from lndrl.numbering import checkpoint_name
from lndrl.policy import to_bytes
from lndrl.policy.device import machine_with
from lndrl.transport import LearnerEndpoint
from lndrl.transport.status import LEARNER_ACTIVITIES

_MOST_FAILURES = 3  # updates in a row that diverge before the learner gives up


class Learner:
    """One training run, from its start or from a checkpoint.

    Args:
        config: the resolved configuration.
        path: the run's folder; must not exist unless ``resume``.
        endpoint: the open transport.
        resume: go on from a checkpoint of ``path``.
        checkpoint: which one; the newest by default.
        crew: the other ranks of this learner, which is rank 0 then.

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
        crew: Crew | None = None,
    ) -> None:
        keep_freed_memory()
        self.config = config
        self.endpoint = endpoint
        self.crew = crew
        self.ppo = PPO(config, team=crew.team if crew is not None else None)
        check_messages(config, len(to_bytes(self.ppo.policy)), endpoint.largest_message)
        check_queue(config)
        _check_teacher(config)
        self.store = RolloutStore(pinned=self.ppo.device.type == "cuda")
        self.roster, self.counters = Roster(), Counters()
        begin = "from scratch"
        chosen: Path | None = None
        books: dict[str, Any] = {}
        if resume:
            self.folder = RunFolder.open(path)
            chosen, books = self._load(checkpoint)
        else:
            if config.learner.start is not None:
                begin = f"from the networks of {start_from(config.learner.start, self.ppo)}"
            self.folder = RunFolder.create(path, config)
        self.events = EventLog(self.folder.events, quiet)
        self.orders = Orders(self.folder.run_id, self.events)
        on_change = self.events.on_disk_change
        self.accounts = Accounts(
            Ledger(self.folder.ledger, lambda error: on_change("ledger.jsonl", error))
        )
        self.ingest = Ingest(
            *(config, self.folder.run_id, endpoint.incarnation, self.roster, self.events),
            *(self.accounts, endpoint.largest_message, crew.lanes if crew is not None else None),
        )
        self.whole = Whole(self.ingest)
        self.episodes = EpisodeWindow(self.counters.episodes, tuple(config.task.reward.terms))
        self.split, self.session = TimeSplit(LEARNER_ACTIVITIES), Session()
        self.figures: dict[str, float] = {}
        self.lag: dict[str, float] = {}
        self.lag_shares: list[float] = []  # of samples, by lag
        self.history, self.load = History(), Load()
        self.last_checkpoint: tuple[Path, float] | None = None  # and when, monotonic s
        self.first_update: float | None = None  # of this session, monotonic s
        self._memory = MemoryTide(self.ppo.each_thread)
        self._sender = Sender(config, lambda text: self.events.add("weights", text))
        self._phase = self._learned_in = ""  # announced last; that of the newest update
        self.started = time.monotonic()
        self._elapsed_before, self._failures = self.counters.elapsed, 0
        self._announce(f"from step {self.counters.steps:,}" if resume else begin)
        aside = self._take_up(chosen, books) if chosen is not None else []
        self.recorder = Recorder(self.folder.path, self.counters.updates, on_change)
        self.history.take_up(self.folder.path / "metrics.jsonl", history_row)
        self.validation = self._validation(self.counters.steps if aside else None)

    # -- the loop ----------------------------------------------------------------------------

    def run(self, stop: Event) -> None:
        """Train until the run is ``finished``, or until ``stop`` is set."""
        if self.crew is not None:
            self.crew.stop = stop
        self.begin()
        self.orders.heed(stop)
        while not self.finished and not stop.is_set():
            self.advance(timeout=0.2)
            if self.orders.checkpoint_due():
                self.checkpoint()
        self.orders.ignore()
        if self.finished:
            self.validation.finish(self.recorder, self.counters.updates, stop)
        self.end()

    def begin(self) -> None:
        """Open the door to actors and offer them weights."""
        if self.crew is not None:
            endpoint = self.config.transport.endpoint
            self.crew.begin(self.ppo, self.counters, self.ingest, endpoint)
        if self.last_checkpoint is None and not self.counters.updates:
            self.checkpoint()  # a learner that dies early can be resumed, too
        self.ingest.weights_version = self.counters.version
        self.endpoint.start(self.ingest, self.validation, self.orders)
        self._publish()

    def advance(self, timeout: float) -> bool:
        """One update if a batch comes within ``timeout`` s; whether there was one.

        Raises UserError when several batches in a row made it diverge.
        """
        self._memory.turn()
        self.validation.turn(self.recorder, self.counters.updates)
        with self.split.during("wait"):
            chunks = self._collect(timeout)
        if chunks is None:
            return False
        began = time.monotonic()
        with self.split.during("ingest"):
            batch = assemble([chunk.trajectory for chunk in chunks], self.store)
        with self.split.during("update"):
            learned = self._update(batch, chunks)
            if self.crew is not None:
                self.crew.updated()
        if not learned:
            return False
        with self.split.during("publish"):
            self._publish()
        self._record(chunks, time.monotonic() - began)
        if self.finished or self.counters.updates % self.config.learner.checkpoint_interval == 0:
            self.checkpoint()
        return True

    def end(self) -> None:
        """Leave a checkpoint and say goodbye; the endpoint stays open for last answers."""
        self.ingest.close()
        if self.crew is not None:
            self.crew.shut(self.whole)
        self.validation.turn(self.recorder, self.counters.updates)
        if self.counters.updates and (
            self.last_checkpoint is None
            or self.last_checkpoint[0].name != checkpoint_name(self.counters.steps)
        ):
            self.checkpoint()
        if self.crew is not None:
            self.crew.close_books(self.ppo, self.ingest, self.events.add)
        if self.finished:
            self.ingest.finish()
            self.endpoint.finish()
            if self.crew is not None:
                self.crew.finish()
        try:
            self.folder.write_summary(self.summary().to_dict())
        except OSError as error:
            self.events.add("disk", f"summary.json cannot be written ({error.strerror or error})")
        word = "finished" if self.finished else "stopped"
        why = f": {self.early}" if self.early else ""
        self.events.add("end", f"{word} at step {self.counters.steps:,}{why}")

    def close(self) -> None:
        """Release threads and files; the endpoint belongs to whoever opened it."""
        self.ppo.close()
        self.recorder.close()
        self.accounts.close()
        self.events.close()
        self.folder.release()

    # -- steps of the loop -------------------------------------------------------------------

    def _collect(self, timeout: float) -> list[Chunk] | None:
        if self.config.learner.mode == "lockstep":
            return self.ingest.take_round(self.config.fixed_actors, timeout)
        size = batch_size(self.config.ppo, self._progress)
        if self.crew is None:
            return self.ingest.take(size, timeout)
        return self.crew.collect(
            self.ingest, self.whole, size, self.counters, timeout, self.events.add
        )

    @property
    def _progress(self) -> float:
        """Share of the run's steps that are done, for all that changes over a run."""
        return min(1.0, self.counters.steps / self.config.learner.total_steps)

    def _announce(self, where: str) -> None:
        """Say what begins ``where``, and what whoever runs it should know."""
        self.events.add("start", f"run {self.folder.run_id} {where}")
        self.events.add("machine", machine_with(self.ppo.device))
        for note in self.config.scenario.map_notes:
            self.events.add("map", note)
        if self.folder.unlocked:
            text = f"the folder cannot be locked ({self.folder.unlocked}): let no other learner in"
            self.events.add("disk", text)

    def _load(self, checkpoint: str | None) -> tuple[Path, dict[str, Any]]:
        """Go on from a checkpoint of the folder; returns which, and the books in it."""
        folder = self.folder
        try:
            clean_up(folder.checkpoints)
            chosen = find_checkpoint(folder.checkpoints, checkpoint)
            self.counters, books = load_checkpoint(chosen, self.ppo)
            folder.write_config(self.config)
        except BaseException:
            folder.release()
            raise
        return chosen, books

    def _take_up(self, checkpoint: Path, books: dict[str, Any]) -> list[str]:
        """Learn from the checkpoint and the ledger what came in before, and what was lost.

        Returns the names of the checkpoints that this one leaves behind.
        """
        self.accounts.fold_left(self.folder.path, self.crew.leftovers() if self.crew else [])
        try:
            self.roster.restore(books["roster"])
            recovery = self.accounts.resume(
                books.get("accounts"),
                self.counters.updates,
                lambda chunk: self.roster.is_known(*chunk),
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            self.folder.release()
            raise UserError(damaged(checkpoint, error)) from None
        self.roster.reconcile(recovery.settled, recovery.excused)
        self.ingest.newest_version = recovery.newest_version
        if self.crew is not None:
            self.crew.excused = recovery.excused
        for note in recovery.notes:
            self.events.add("ledger", note)
        if recovery.lost.chunks:
            text = f"{recovery.lost} were acknowledged and are not in the checkpoint"
            self.events.add("restart", text)
        aside = set_aside_later(checkpoint)
        if aside:
            text = f"set aside as abandoned, the run goes on before: {', '.join(aside)}"
            self.events.add("checkpoint", text)
        return aside

    def _validation(self, went_back_to: int | None) -> Validation:
        """The desk for evaluators, with what earlier sessions found; see ``take_up`` there."""
        folder = self.folder
        found = Validation(
            self.config, folder.run_id, self.endpoint.incarnation, folder.checkpoints, self.events
        )
        found.take_up(read_curve(folder.path / "metrics.jsonl"), went_back_to)
        return found

    def _update(self, batch: Batch, chunks: list[Chunk]) -> bool:
        """Learn from ``chunks``, or drop them where the update diverges; whether it learned."""
        lag = np.maximum(self.counters.version - batch.version, 0)
        try:
            self.figures = self.ppo.update(batch, self._progress, self.stage)
        except DivergedError as error:
            self._diverged(chunks, error)
            return False
        self._failures = 0
        self._learned_in = self.stage.phase
        self.lag = {"mean": float(lag.mean()), "max": int(lag.max())}
        self.lag_shares = self.session.learned(lag)
        self.counters.steps += len(batch)
        self.counters.updates += 1
        self.accounts.train(self.counters.updates, [chunk.id for chunk in chunks])
        return True

    def _diverged(self, chunks: list[Chunk], error: DivergedError) -> None:
        """Go on with the state from before the update, which ``ppo`` has restored."""
        self._failures += 1
        self.accounts.drop("diverged", [chunk.id for chunk in chunks])
        update = self.counters.updates + 1
        text = f"update {update}: {error}; its batch is dropped, networks are as before it"
        self.events.add("diverged", text)
        # In lock-step the actors would wait for ever for the weights of this round.
        if self._failures < _MOST_FAILURES and self.config.learner.mode != "lockstep":
            return
        newest = self.last_checkpoint
        kept = f"the checkpoint {newest[0].name} is intact" if newest else "no checkpoint was saved"
        raise UserError(
            f"training diverged at update {update}, {self._failures} times in a row ({error}); "
            f"{kept}, resume with a lower learning rate"
        ) from None

    def _publish(self) -> None:
        """Offer the current weights under the next version."""
        if self.counters.updates:
            self.counters.version = self.counters.updates
        self.ingest.weights_version = self.counters.version
        stage = self.stage
        if self.config.ppo.teacher is not None and stage.phase != self._phase:
            self._phase = stage.phase
            self.events.add("phase", stage.words(self.config))
        blob = self._sender(self.ppo.acting, stage.guidance.to_metadata())
        counters = self.counters
        tested = None
        other = self._sender.rounds or self.ppo.tested is not self.ppo.acting
        if self.config.learner.validation_episodes and other:
            tested = to_bytes(self.ppo.tested)
        self.endpoint.publish_weights(counters.version, blob, tested)
        self.validation.offer(counters.version, counters.steps, self.elapsed, tested or blob)

    def _record(self, chunks: list[Chunk], seconds: float) -> None:
        for chunk in chunks:
            self.episodes.add(chunk.episodes)
            self.session.ended(chunk.episodes)
        self.counters.episodes = self.episodes.count
        self.counters.elapsed = self.elapsed
        samples = sum(chunk.samples for chunk in chunks)
        row = metrics_row(self, self._learned_in, samples, seconds)
        self.recorder.add(row)
        self.first_update = self.first_update or time.monotonic()
        self.history.add(history_row(row))

    def checkpoint(self) -> None:
        """Write a checkpoint; a disk that refuses is reported and training goes on."""
        with self.split.during("checkpoint"):
            crew, books = self.crew, self.ingest.to_state()
            if crew is not None:
                books = crew.books(self.ppo, self.ingest, self.events.add)
            try:
                path = save_checkpoint(
                    self.folder.checkpoints,
                    self.ppo,
                    self.counters,
                    books,
                    self.config.learner.keep_checkpoints,
                )
            except OSError as error:
                self.events.add("disk", f"no checkpoint at step {self.counters.steps:,}: {error}")
                return
            others = crew.fold(self.accounts) if crew is not None else []
            self.accounts.checkpointed(self.counters.updates, self.counters.steps, others)
        self.last_checkpoint = (path, time.monotonic())
        self.events.add("checkpoint", path.name)

    # -- what others may ask -----------------------------------------------------------------

    @property
    def finished(self) -> bool:
        """Whether the configured number of steps is reached, or arrivals no longer rise."""
        return self._has_its_steps or self.validation.standstill is not None

    @property
    def early(self) -> str:
        """Why the run is finished before its steps; empty where it is not."""
        found = self.validation.standstill
        return "" if found is None or self._has_its_steps else str(found)

    @property
    def _has_its_steps(self) -> bool:
        return self.counters.steps >= self.config.learner.total_steps

    @property
    def stage(self) -> Stage:
        """What the policy learns from now: a teacher, reward, or both."""
        return stage_of(self.config, self.counters.steps)

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
            seconds=self.counters.elapsed if self.finished else self.elapsed,
            episodes=self.episodes.figures(),
            dropped=self.whole.dropped(),
            accounts=self.whole.accounts(),
            checkpoint=self.last_checkpoint[0] if self.last_checkpoint else None,
            early=self.early,
        )


def _check_teacher(config: RunConfig) -> None:
    """Raise UserError where no actor could build the teacher, before there is a folder."""
    if config.ppo.teacher is not None:
        from lndrl.planners import teacher_of  # loads what no other run needs

        teacher_of(config)
