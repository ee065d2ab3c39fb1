"""Malformed messages and files against a real learner that trains meanwhile."""

from __future__ import annotations

import signal
import statistics
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any

from rich import box
from rich.table import Table

from lndrl.chaos.files import FileFindings, fuzz_files
from lndrl.chaos.flood import CONNECT_WITHIN, Sent
from lndrl.chaos.ledger import LearnerBook, files_of, lines_of
from lndrl.chaos.monitor import Monitor, Tail, cpu_seconds
from lndrl.chaos.run import start
from lndrl.chaos.stage import LEAVE_WITHIN, Child, Stage
from lndrl.chaos.turns import CALM, Cost, Mark, cost

FILES_PER_MESSAGE = 0.01
MOST_FILES = 1000
BEAT = 0.02  # s; as much as that an update may seem later than it was


@dataclass(frozen=True)
class FuzzReport:
    """What malformed messages and files did."""

    seed: int
    messages: Sent
    files: FileFindings
    deaths: int
    tracebacks: int
    cost: Cost
    memory_growth: float | None
    memory_by_fifth: list[float]
    lost: int
    duplicated: int
    seconds: float
    last_words: str

    @property
    def crashes(self) -> int:
        """Learners that died, tracebacks in their log, loaders that raised anything odd."""
        return self.deaths + self.tracebacks + self.files.crashes

    @property
    def good(self) -> bool:
        """Whether nothing crashed, and nothing was taken that could not be."""
        wrong = self.crashes + len(self.messages.taken) + self.lost + self.duplicated
        return wrong == 0 and self.messages.count > 0

    @property
    def examples(self) -> list[str]:
        """Words about what went wrong."""
        words = [f"taken: {what}" for what in sorted(set(self.messages.taken))[:10]]
        return [*words, *self.files.examples, *([self.last_words] if self.last_words else [])]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for ``--json``."""
        answers, floods, cost = self.messages.answers, self.messages.floods, self.cost
        rates = [flood.rate for flood in floods]
        return {
            "seed": self.seed,
            "sent": self.messages.count + self.files.given,
            "refused": answers["refused"] + self.files.refused,
            "crashes": self.crashes,
            "messages": self.messages.count,
            "messages_by_kind": dict(sorted(self.messages.kinds.items())),
            "answers": dict(sorted(answers.items())),
            "taken_wrongly": len(self.messages.taken),
            "files": self.files.given,
            "files_by_kind": dict(sorted(self.files.kinds.items())),
            "files_refused": self.files.refused,
            "file_crashes": self.files.crashes,
            "learner_deaths": self.deaths,
            "learner_tracebacks": self.tracebacks,
            "floods": len(floods),
            "messages_per_second": statistics.median(rates) if rates else None,
            "rate_calm": cost.calm,
            "rate_flood": cost.flood,
            "rate_ratio": cost.ratio,
            "rate_ratio_least": cost.least,
            "rate_ratio_most": cost.most,
            "learner_ms_per_message": cost.ms_per_message,
            "memory_growth": self.memory_growth,
            "memory_megabytes_by_fifth": self.memory_by_fifth,
            "lost": self.lost,
            "duplicated": self.duplicated,
            "seconds": round(self.seconds, 1),
            "examples": self.examples,
        }


def run_fuzz(
    count: int,
    seed: int,
    rate: float,
    folder: Path,
    stop: Event | None = None,
    show: Callable[[str], None] = lambda line: None,
) -> FuzzReport:
    """Send ``count`` malformed messages, ``rate`` per second of flood, then damage files.

    ``stop`` ends it early. Raises TimeoutError when training does not begin, RuntimeError when
    the sender ends at once.
    """
    stop = stop or Event()
    stage = Stage(folder.resolve(), 1, seed, rogue=False)
    monitor = Monitor(stage.learner_ledger(), stage.endpoint)
    try:
        show("starting")
        start(stage, monitor, stop)
        flood = _Watch(stage, monitor, stop, show)
        flood.run(count, seed, rate)
        died = not stage.learner.alive()
        stage.finish()
    finally:
        monitor.close()
        stage.close()
    show("damaging files")
    files = int(min(count * FILES_PER_MESSAGE + 20, MOST_FILES))
    found = fuzz_files(files, seed, folder / "files", stop.is_set)
    book = LearnerBook().read(lines_of(*files_of(stage.learner_ledger())))
    tracebacks = stage.learner.log().count("Traceback")
    return FuzzReport(
        seed=seed,
        messages=flood.sent,
        files=found,
        deaths=int(died),
        tracebacks=tracebacks,
        cost=flood.cost(),
        memory_growth=monitor.memory_growth(),
        memory_by_fifth=monitor.memory_by_fifth(),
        lost=sum(book.lost().values()),
        duplicated=book.duplicated,
        seconds=flood.end - flood.begin,
        last_words=stage.learner.tail() if died or tracebacks else "",
    )


def fuzz_tables(report: FuzzReport) -> list[Table]:
    """The report for people."""
    table = Table(title=f"malformed messages and files, seed {report.seed}", box=box.SIMPLE_HEAD)
    table.add_column("")
    table.add_column("", justify="right")
    for name, value in report.to_dict().items():
        if isinstance(value, dict):
            for kind, number in value.items():
                table.add_row(f"  {name.replace('_', ' ')}: {kind}", f"{number:,}")
        elif isinstance(value, int | float):
            table.add_row(name.replace("_", " "), f"{value:,.6g}")
    return [table]


class _Watch:
    """Lets the floods come, and marks the learner at every update meanwhile."""

    def __init__(
        self, stage: Stage, monitor: Monitor, stop: Event, show: Callable[[str], None]
    ) -> None:
        self.sent = Sent()
        self.begin = self.end = time.monotonic()
        self._marks: list[Mark] = []
        self._stage, self._monitor, self._stop, self._show = stage, monitor, stop, show

    def run(self, count: int, seed: int, rate: float) -> None:
        """From the first calm to the last; ends early when the learner does."""
        command = ["lndrl.chaos.flood", "--connect", self._stage.endpoint, "--seed", str(seed)]
        command += ["--count", str(count), "--rate", str(rate), "--within", str(CONNECT_WITHIN)]
        command += ["--calm", *map(str, CALM)]
        sender = self._stage.add("flood", command)
        heard = Tail(sender.log_path)
        self._until(lambda: self._hear(heard.lines()), sender)
        if sender.process is not None and sender.process.poll():
            raise RuntimeError(f"nothing could be sent: {sender.tail(500)}")
        self.begin = time.monotonic()

        def look() -> bool:
            self._hear(heard.lines())
            trained = f"{self._monitor.rate(time.monotonic() - 10.0, time.monotonic()):.0f} steps/s"
            self._show(f"{self.sent.count:,} of {count:,} messages sent, {trained}")
            return not sender.alive()

        self._until(look, self._stage.learner)
        if self._stop.is_set():
            sender.send(signal.SIGINT)
            sender.wait(LEAVE_WITHIN)
        self._hear(heard.lines())
        calm = time.monotonic() + CALM[1]
        self._until(lambda: time.monotonic() > calm, self._stage.learner)
        self.end = time.monotonic()

    def cost(self) -> Cost:
        """What the floods cost the learner."""
        return cost(self._marks, self.sent.floods, self.begin, self.end)

    def _until(self, done: Callable[[], bool], child: Child) -> None:
        """Mark until it is done, ``child`` has ended or somebody stops it."""
        while not (done() or self._stop.is_set()) and child.alive():
            before = self._monitor.trained
            self._monitor.look()
            cpu = cpu_seconds(self._stage.learner.pid)
            if self._monitor.trained > before and cpu is not None:
                self._marks.append(Mark(time.monotonic(), self._monitor.trained, cpu))
            self._stop.wait(BEAT)

    def _hear(self, lines: Sequence[str]) -> bool:
        """Take in the newest line; whether there was one that can be read."""
        for line in reversed(lines):
            with suppress(ValueError, KeyError, TypeError):
                self.sent = Sent.read(line)
                return True
        return False
