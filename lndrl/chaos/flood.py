"""Sends malformed messages to a learner, in turns: ``python -m lndrl.chaos.flood``.

A process of its own, at the lowest priority: forging takes the time that learner and actors leave,
and so what a flood does to them is what the messages do.
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import sys
import time
from collections import Counter, deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import Event
from typing import Any

from lndrl.chaos.forged import forged_hello
from lndrl.chaos.messages import Forger, Malformed
from lndrl.chaos.stage import wait_for
from lndrl.chaos.turns import CALM, Flood, durations
from lndrl.config import TransportConfig, parse_config
from lndrl.errors import UserError
from lndrl.machine.signals import stop_handler
from lndrl.transport import Ack, MessageError, Refusal, Welcome
from lndrl.transport.keys import HELLO
from lndrl.transport.messages import decode, encode
from lndrl.transport.zenoh.session import (
    UnreachableError,
    ZenohSession,
    first_answer,
    open_connecting,
)

SESSIONS = 4
OPEN_QUERIES = 16  # of a session, whose answers it has yet to read
ANSWER_SECONDS = 5.0
MOST_ANSWERS = 64  # to one query: a key with wildcards asks everything that the learner answers
PATIENCE = 60.0
CONNECT_WITHIN = 10.0
"""s after which no learner answers."""
LOWEST = 19


@dataclass
class Sent:
    """What was sent and heard; ``floods`` with their times."""

    count: int = 0
    answers: Counter[str] = field(default_factory=Counter)
    kinds: Counter[str] = field(default_factory=Counter)
    taken: list[str] = field(default_factory=list)  # hopeless ones that were taken nevertheless
    floods: list[Flood] = field(default_factory=list)

    def to_json(self) -> str:
        """One line."""
        floods = [asdict(flood) for flood in self.floods]
        return json.dumps({**vars(self), "floods": floods})

    @classmethod
    def read(cls, line: str) -> Sent:
        """From ``to_json``; raises ValueError, KeyError, TypeError."""
        data = json.loads(line)
        return cls(
            data["count"],
            Counter(data["answers"]),
            Counter(data["kinds"]),
            data["taken"],
            [Flood(**flood) for flood in data["floods"]],
        )


class Sender:
    """One session and its forger."""

    def __init__(
        self, endpoint: str, seed: int, count: int, rate: float, stop: Event, within: float
    ) -> None:
        self.sent = Sent()
        self._count, self._rate, self._stop = count, rate, stop
        self._open_queries: deque[tuple[Malformed, Any]] = deque()
        try:
            config = TransportConfig(endpoint=endpoint)
            self._session: ZenohSession = open_connecting(endpoint, config, within)
        except UnreachableError:
            raise UserError(f"no learner answers at {endpoint}") from None
        self._forger = self._introduced(seed)

    @property
    def done(self) -> bool:
        """Whether it has sent all."""
        return self.sent.count >= self._count

    def flood(self, until: float) -> float:
        """Send until that moment, then read what is left to read; returns when the last went."""
        began = last = time.monotonic()
        before = self.sent.count
        while not (self.done or self._stop.is_set() or self._session.closing):
            if (last := time.monotonic()) >= until:
                break
            self._send_one()
            while len(self._open_queries) > OPEN_QUERIES:
                self._read()
            due = began + (self.sent.count - before) / self._rate
            self._stop.wait(max(0.0, min(due, until) - time.monotonic()))
        while self._open_queries and not self._stop.is_set():
            self._read()
        return last

    def close(self) -> None:
        """Leave."""
        self._session.close()

    def _introduced(self, seed: int) -> Forger:
        """A forger that knows the run, from an honest hello."""
        hello = encode(forged_hello(f"fuzz-{seed}", secrets.token_hex(4)))
        sample = wait_for("welcome", lambda: self._session.query(HELLO, hello, 5.0), PATIENCE)
        assert sample is not None
        welcome, _ = decode(sample.payload.to_bytes(), Welcome)
        config = parse_config(welcome.config, "configuration from the learner")
        version = max(0, welcome.weights_version)
        return Forger(config, welcome.run_id, version, seed, f"fuzz-{seed}")

    def _send_one(self) -> None:
        message = self._forger.draw()
        try:
            self._send(message)
        except Exception:  # zenoh itself refuses some keys: then nothing was sent
            self.sent.answers["not sendable"] += 1
            return
        self.sent.count += 1
        self.sent.kinds[message.kind] += 1

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


def run_floods(
    endpoint: str,
    seed: int,
    count: int,
    rate: float,
    stop: Event,
    tell: Any,
    calm: tuple[float, float] = CALM,
    within: float = CONNECT_WITHIN,
) -> None:
    """Calm and flood in turns until ``count`` messages went; ``tell`` hears a Sent after each.

    ``rate``: messages per s of flood, all sessions together; ``calm``: s of one, least and most.
    The first Sent, with nothing in it, says that the first calm begins. Raises UserError where no
    learner answers ``within`` s.
    """
    shares = [count // SESSIONS + (number < count % SESSIONS) for number in range(SESSIONS)]
    senders: list[Sender] = []
    try:
        for number, share in enumerate(shares):
            name = seed * SESSIONS + number
            senders.append(Sender(endpoint, name, share, rate / SESSIONS, stop, within))
        floods: list[Flood] = []
        tell(_together(senders, floods))
        with ThreadPoolExecutor(SESSIONS) as pool:
            for pause, wild in durations(seed, calm):
                if stop.wait(pause):
                    return
                before = sum(sender.sent.count for sender in senders)
                began = time.monotonic()
                ends = list(pool.map(Sender.flood, senders, [began + wild] * SESSIONS))
                messages = sum(sender.sent.count for sender in senders) - before
                floods.append(Flood(began, max(ends), messages))
                tell(_together(senders, floods))
                if all(sender.done for sender in senders):
                    return
    finally:
        for sender in senders:
            sender.close()


def _together(senders: Sequence[Sender], floods: Sequence[Flood]) -> Sent:
    whole = Sent(floods=list(floods))
    for part in (sender.sent for sender in senders):
        whole.count += part.count
        whole.answers += part.answers
        whole.kinds += part.kinds
        whole.taken += part.taken
    return whole


def _word(data: bytes) -> str:
    try:
        answer, _ = decode(data, Ack, Refusal, Welcome)
    except MessageError:
        return "answered"
    if isinstance(answer, Ack):
        return answer.status
    return "refused" if isinstance(answer, Refusal) else "welcomed"


def _step_back() -> None:
    """The lowest priority, for this process and the session that it leads."""
    with suppress(OSError):
        os.nice(LOWEST)
    # Where the kernel shares cores among sessions first, a nice process alone would gain nothing.
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(LOWEST), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Floods from the command line; prints what was sent so far as a line of JSON each time."""
    parser = argparse.ArgumentParser(prog="python -m lndrl.chaos.flood", description=__doc__)
    parser.add_argument("--connect", required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--rate", type=float, default=250.0)
    parser.add_argument("--calm", type=float, nargs=2, default=CALM, metavar=("LEAST", "MOST"))
    parser.add_argument("--within", type=float, default=CONNECT_WITHIN)
    options = parser.parse_args(arguments)
    _step_back()
    stop = Event()

    def tell(sent: Sent) -> None:
        print(sent.to_json(), flush=True)

    try:
        with stop_handler(lambda *_: stop.set()):
            run_floods(
                options.connect, options.seed, options.count, options.rate, stop, tell,
                tuple(options.calm), options.within,
            )  # fmt: skip
    except (UserError, TimeoutError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
