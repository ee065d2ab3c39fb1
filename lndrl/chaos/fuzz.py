"""Malformed messages and files against a real learner that trains meanwhile."""

from __future__ import annotations

import secrets
import statistics
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Thread
from typing import Any

from rich import box
from rich.table import Table

from lndrl.chaos.files import FileFindings, fuzz_files
from lndrl.chaos.forged import forged_hello
from lndrl.chaos.ledger import LearnerBook, lines_of
from lndrl.chaos.messages import Forger, Malformed
from lndrl.chaos.monitor import Monitor, resources
from lndrl.chaos.run import start
from lndrl.chaos.stage import Stage, wait_for
from lndrl.config import TransportConfig, parse_config
from lndrl.errors import UserError
from lndrl.transport import Ack, MessageError, Refusal, Welcome
from lndrl.transport.keys import HELLO
from lndrl.transport.messages import decode, encode
from lndrl.transport.zenoh_session import (
    UnreachableError,
    ZenohSession,
    first_answer,
    open_connecting,
)

SESSIONS = 4
OPEN_QUERIES = 16  # of a session, whose answers it has yet to read
ANSWER_SECONDS = 5.0
MOST_ANSWERS = 64  # to one query: a key with wildcards asks everything that the learner answers
FILES_PER_MESSAGE = 0.01
MOST_FILES = 1000
CALM = (5.0, 30.0)
"""s, least and most, over which the rate is taken before and after."""

PATIENCE = 60.0


@dataclass
class Sent:
    """What one session sent and heard."""

    count: int = 0
    answers: Counter[str] = field(default_factory=Counter)
    kinds: Counter[str] = field(default_factory=Counter)
    taken: list[str] = field(default_factory=list)  # hopeless ones that were taken nevertheless


@dataclass(frozen=True)
class FuzzReport:
    """What ``sent`` malformed messages and files did. Rates are samples trained per second."""

    seed: int
    messages: Sent
    files: FileFindings
    deaths: int
    tracebacks: int
    rate_before: float
    rate_while: float
    rate_after: float
    memory_growth: float | None
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
        answers = self.messages.answers
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
            "rate_before": round(self.rate_before, 1),
            "rate_while": round(self.rate_while, 1),
            "rate_after": round(self.rate_after, 1),
            "memory_growth": self.memory_growth,
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
    """Send ``count`` malformed messages, ``rate`` per second, and damage files meanwhile.

    ``stop`` ends it early. Raises TimeoutError when training does not begin.
    """
    stop = stop or Event()
    stage = Stage(folder.resolve(), 1, seed, rogue=False)
    monitor = Monitor(stage.learner_ledger(), stage.endpoint)
    calm = min(max(CALM[0], count / rate / 4), CALM[1])
    try:
        show("starting")
        start(stage, monitor, stop)
        before = _watch(monitor, stop, calm, lambda left: show(f"rate before: {left:.0f} s left"))
        memory = _memory(stage)
        began = time.monotonic()
        senders = [_Sender(stage.endpoint, seed * SESSIONS + i, stop) for i in range(SESSIONS)]
        for i, sender in enumerate(senders):
            sender.begin(count // SESSIONS + (i < count % SESSIONS), rate / SESSIONS)
        files = int(min(count * FILES_PER_MESSAGE + 20, MOST_FILES))
        found = fuzz_files(files, seed, folder / "files", stop.is_set)
        while any(sender.alive() for sender in senders) and not stop.is_set():
            monitor.look()
            done = sum(sender.sent.count for sender in senders)
            trained = f"{monitor.rate(time.monotonic() - 10.0, time.monotonic()):.0f} steps/s"
            show(f"{done:,} of {count:,} messages sent, {trained}")
            if not stage.learner.alive():
                break
            stop.wait(0.1)
        monitor.look()
        during = monitor.rate(began, time.monotonic())
        seconds = time.monotonic() - began
        after = _watch(monitor, stop, calm, lambda left: show(f"rate after: {left:.0f} s left"))
        now = _memory(stage)
        died = not stage.learner.alive()
        for sender in senders:
            sender.close()
        stage.finish()
    finally:
        monitor.close()
        stage.close()
    book = LearnerBook().read(lines_of(stage.learner_ledger()))
    tracebacks = stage.learner.log().count("Traceback")
    return FuzzReport(
        seed=seed,
        messages=_together([sender.sent for sender in senders]),
        files=found,
        deaths=int(died),
        tracebacks=tracebacks,
        rate_before=before,
        rate_while=during,
        rate_after=after,
        memory_growth=now / memory - 1.0 if now and memory else None,
        lost=sum(book.lost().values()),
        duplicated=book.duplicated,
        seconds=seconds,
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


class _Sender:
    """One session that sends malformed messages in a thread of its own."""

    def __init__(self, endpoint: str, seed: int, stop: Event) -> None:
        self.sent = Sent()
        self._endpoint, self._seed, self._stop = endpoint, seed, stop
        self._session = self._open()
        self._open_queries: deque[tuple[Malformed, Any]] = deque()
        self._thread: Thread | None = None

    def begin(self, count: int, rate: float) -> None:
        """Send ``count`` messages, ``rate`` per second."""
        self._thread = Thread(target=self._run, args=(count, rate), daemon=True)
        self._thread.start()

    def alive(self) -> bool:
        """Whether it still sends."""
        return self._thread is not None and self._thread.is_alive()

    def close(self) -> None:
        """Leave."""
        self._session.close()
        if self._thread is not None:
            self._thread.join(ANSWER_SECONDS)

    def _open(self) -> ZenohSession:
        try:
            return open_connecting(self._endpoint, TransportConfig(endpoint=self._endpoint), 10.0)
        except UnreachableError:
            raise UserError(f"no learner answers at {self._endpoint}") from None

    def _forger(self) -> Forger:
        """One that knows the run, from an honest hello."""
        hello = encode(forged_hello(f"fuzz-{self._seed}", secrets.token_hex(4)))
        sample = wait_for("welcome", lambda: self._session.query(HELLO, hello, 5.0), PATIENCE)
        assert sample is not None
        welcome, _ = decode(sample.payload.to_bytes(), Welcome)
        config = parse_config(welcome.config, "configuration from the learner")
        version = max(0, welcome.weights_version)
        return Forger(config, welcome.run_id, version, self._seed, f"fuzz-{self._seed}")

    def _run(self, count: int, rate: float) -> None:
        forger = self._forger()
        began = time.monotonic()
        while self.sent.count < count and not self._stop.is_set() and not self._session.closing:
            message = forger.draw()
            try:
                self._send(message)
            except Exception:  # zenoh itself refuses some keys: then nothing was sent
                self.sent.answers["not sendable"] += 1
                self._stop.wait(0.001)
                continue
            self.sent.count += 1
            self.sent.kinds[message.kind] += 1
            while len(self._open_queries) > OPEN_QUERIES:
                self._read()
            self._stop.wait(max(0.0, began + self.sent.count / rate - time.monotonic()))
        while self._open_queries and not self._stop.is_set():
            self._read()

    def _send(self, message: Malformed) -> None:
        session = self._session
        if message.way == "query":
            channel = session.ask(
                message.key, message.payload, ANSWER_SECONDS, answers=MOST_ANSWERS
            )
            self._open_queries.append((message, channel))
            return
        if message.way == "put":
            session.zenoh.put(message.key, message.payload)
        else:
            session.zenoh.liveliness().declare_token(message.key).undeclare()
        self.sent.answers["one way"] += 1

    def _read(self) -> None:
        message, channel = self._open_queries.popleft()
        sample = first_answer(channel)
        answer = _word(sample.payload.to_bytes()) if sample is not None else "unanswered"
        self.sent.answers[answer] += 1
        if message.hopeless and answer in ("accepted", "duplicate", "welcomed"):
            self.sent.taken.append(f"{message.kind}, {message.what}: {answer}")


def _word(data: bytes) -> str:
    try:
        answer, _ = decode(data, Ack, Refusal, Welcome)
    except MessageError:
        return "answered"
    if isinstance(answer, Ack):
        return answer.status
    return "refused" if isinstance(answer, Refusal) else "welcomed"


def _watch(monitor: Monitor, stop: Event, seconds: float, show: Callable[[float], None]) -> float:
    """The rate over ``seconds`` in which nothing is sent."""
    began = time.monotonic()
    while (left := began + seconds - time.monotonic()) > 0 and not stop.is_set():
        monitor.look()
        show(left)
        stop.wait(0.2)
    monitor.look()
    return monitor.rate(began, time.monotonic())


def _memory(stage: Stage) -> float | None:
    """Resident bytes of the learner, the median of a few looks."""
    looks = [used[0] for _ in range(5) if (used := resources(stage.learner.pid)) is not None]
    return statistics.median(looks) if looks else None


def _together(parts: list[Sent]) -> Sent:
    whole = Sent()
    for part in parts:
        whole.count += part.count
        whole.answers += part.answers
        whole.kinds += part.kinds
        whole.taken += part.taken
    return whole
