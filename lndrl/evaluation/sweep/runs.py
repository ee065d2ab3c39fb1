"""Working runs off: which run is next, and what becomes of it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from threading import Event
from typing import Literal, Protocol

from lndrl.errors import UserError
from lndrl.evaluation.sweep.folder import Run, RunsFolder

_ATTEMPTS = 2  # per run and session: one failure may be the machine's, two are the run's
_GRACE = 30.0  # s for a checkpoint and the actors' end


@dataclass(frozen=True)
class Job:
    """What a run needs next."""

    run: Run
    kind: Literal["train", "resume", "evaluate"]


class Process(Protocol):
    """A job at work."""

    def poll(self) -> int | None:
        """Exit code, None while it works."""

    def interrupt(self) -> None:
        """Ask for an orderly end, which leaves a checkpoint."""

    def end(self, grace: float) -> None:
        """End it and everything that it started, in order if that takes less than ``grace`` s."""


Launch = Callable[[Job], Process]


@dataclass(frozen=True)
class Progress:
    """How they stand; ``rate`` in steps/s over this session, None before its first update."""

    done: int
    runs: int
    steps_left: int
    rate: float | None
    active: tuple[tuple[Job, int], ...]  # with the steps so far

    @property
    def seconds_left(self) -> float | None:
        """Estimate for all that is left."""
        return self.steps_left / self.rate if self.rate else None


def next_job(folder: RunsFolder, run: Run) -> Job | None:
    """What ``run`` needs next; None when it is done, or has diverged for good."""
    state = folder.state(run)
    if state == "missing":
        return Job(run, "train")
    if state == "begun":
        return Job(run, "resume")
    if state == "finished" and not folder.is_complete(run):
        return Job(run, "evaluate")
    return None


class Work:
    """Runs being worked off, ``parallel`` at a time.

    ``launch`` starts a job, ``say`` gets a sentence per event, ``show`` the progress every
    ``tick`` seconds.
    """

    def __init__(
        self,
        folder: RunsFolder,
        launch: Launch,
        parallel: int = 1,
        say: Callable[[str], None] = lambda words: None,
        show: Callable[[Progress], None] = lambda progress: None,
        tick: float = 1.0,
    ) -> None:
        self.folder, self.launch, self.parallel = folder, launch, parallel
        self.say, self.show, self.tick = say, show, tick
        self.runs = folder.runs
        self._steps = {run.name: folder.steps(run) for run in self.runs}
        self._waiting = deque(run for run in self.runs if next_job(folder, run))
        self._active: dict[str, tuple[Job, Process]] = {}
        self._failures: dict[str, int] = {}
        self._first_steps = sum(self._steps.values())
        self._began = time.monotonic()

    def go(self, stop: Event) -> bool:
        """Work until everything is done or ``stop`` is set; whether everything is done.

        Whatever ends this, no process is left. Raises UserError for a run that fails twice.
        """
        grace = _GRACE
        try:
            while self._active or (self._waiting and not stop.is_set()):
                self._fill(stop)
                self._look(stop)
                self.show(self.progress())
                stop.wait(self.tick) if not stop.is_set() else time.sleep(min(self.tick, 0.2))
        except KeyboardInterrupt:
            grace = 1.0
            raise
        finally:
            for _, process in self._active.values():
                process.interrupt()
            for _, process in self._active.values():
                process.end(grace)
        return not self._waiting

    def progress(self) -> Progress:
        """How it stands now."""
        for name, (job, _) in self._active.items():
            self._steps[name] = self.folder.steps(job.run)
        open_runs = {run.name for run in self._waiting} | set(self._active)
        goals = {run.name: run.config.learner.total_steps for run in self.runs}
        gained = sum(self._steps.values()) - self._first_steps
        elapsed = time.monotonic() - self._began
        return Progress(
            done=len(self.runs) - len(open_runs),
            runs=len(self.runs),
            steps_left=sum(max(0, goals[name] - self._steps[name]) for name in open_runs),
            rate=gained / elapsed if gained > 0 and elapsed > 0 else None,
            active=tuple((job, self._steps[name]) for name, (job, _) in self._active.items()),
        )

    def _fill(self, stop: Event) -> None:
        while self._waiting and len(self._active) < self.parallel and not stop.is_set():
            run = self._waiting.popleft()
            job = next_job(self.folder, run)
            if job is None:
                continue
            self.say(f"{run.name}: {_words(job, self._steps[run.name])}")
            self._active[run.name] = job, self.launch(job)

    def _look(self, stop: Event) -> None:
        """Take leave of what has ended; asked to stop, tell the others, each once."""
        for name, (job, process) in list(self._active.items()):
            code = process.poll()
            if code is None:
                if stop.is_set():
                    process.interrupt()
                continue
            del self._active[name]
            self._steps[name] = self.folder.steps(job.run)
            following = next_job(self.folder, job.run)
            if following is None:
                word = "diverged" if self.folder.state(job.run) == "diverged" else "done"
                early = self.folder.early(job.run)
                why = f": {early}" if early else ""
                self.say(f"{name}: {word} at step {self._steps[name]:,}{why}")
                continue
            self._waiting.appendleft(job.run)
            if stop.is_set():
                self.say(f"{name}: stopped at step {self._steps[name]:,}")
            elif code or following.kind == job.kind:
                self._fail(job, code)

    def _fail(self, job: Job, code: int) -> None:
        name = job.run.name
        self._failures[name] = self._failures.get(name, 0) + 1
        log = self.folder.log_path(job.run)
        last = _last_line(log.read_text(errors="replace", encoding="utf-8") if log.exists() else "")
        if self._failures[name] >= _ATTEMPTS:
            raise UserError(f"{name} failed twice, exit code {code}: {last}; all of it: {log}")
        self.say(f"{name}: failed with exit code {code} ({last}), tried once more")


def _words(job: Job, steps: int) -> str:
    if job.kind == "resume":
        return f"resumed at step {steps:,}"
    return {"train": "starts", "evaluate": "is evaluated"}[job.kind]


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1].strip() if lines else "it said nothing"
