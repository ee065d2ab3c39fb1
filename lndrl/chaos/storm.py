"""Many actors that join at once: ``python -m lndrl.chaos.storm``.

Each is a session of its own that says hello, shows its token and uploads one chunk made by hand,
until the learner settles it. They share a process, because what is tested is the learner.
"""

from __future__ import annotations

import argparse
import json
import secrets
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lndrl.chaos.forged import forged_arrays, forged_header, forged_hello
from lndrl.config import TransportConfig, parse_config
from lndrl.errors import UserError
from lndrl.transport import Ack, Welcome
from lndrl.transport.keys import ACTORS, HELLO, UPLOAD
from lndrl.transport.ledger import Book, Entry
from lndrl.transport.messages import decode, encode
from lndrl.transport.zenoh.session import (
    UnreachableError,
    ZenohSession,
    first_answer,
    open_connecting,
)

AT_ONCE = 32
"""Sessions that are opened side by side, before the storm begins."""

ANSWER_SECONDS = 5.0
"""After which a chunk that was not answered is sent again."""

CONNECT_SECONDS = 10.0


@dataclass
class Joiner:
    """One of them."""

    actor_id: str
    life: str
    session: ZenohSession
    token: Any = None
    channel: Any = None
    entry: Entry | None = None
    answer: str = ""


@dataclass(frozen=True)
class StormReport:
    """What became of ``actors`` joiners. Times in s, from the first hello on."""

    actors: int
    connected: int
    asked_within: float
    welcomed: int
    welcomed_within: float
    accepted: int
    refused: int
    unanswered: int


def storm(endpoint: str, actors: int, seconds: float, ledger: Path) -> StormReport:
    """Let ``actors`` join at once and wait for their acknowledgements, at most ``seconds``.

    Raises UserError when no learner can be reached.
    """
    config = TransportConfig(endpoint=endpoint)
    book = Book(ledger)
    joiners = _connect(endpoint, config, actors)
    try:
        began = time.monotonic()
        for joiner in joiners:
            key = f"{ACTORS}/{joiner.actor_id}/{joiner.life}"
            joiner.token = joiner.session.zenoh.liveliness().declare_token(key)
            hello = encode(forged_hello(joiner.actor_id, joiner.life))
            joiner.channel = joiner.session.ask(HELLO, hello, seconds)
        asked = time.monotonic() - began
        welcomed = [joiner for joiner in joiners if _take_welcome(joiner, book)]
        greeted = time.monotonic() - began
        _settle(welcomed, book, began + seconds)
    finally:
        with ThreadPoolExecutor(AT_ONCE) as pool:
            list(pool.map(lambda joiner: joiner.session.close(), joiners))
        book.close()
    answers = [joiner.answer for joiner in welcomed]
    accepted = sum(answer in ("accepted", "duplicate") for answer in answers)
    unanswered = answers.count("")
    return StormReport(
        actors=actors,
        connected=len(joiners),
        asked_within=round(asked, 3),
        welcomed=len(welcomed),
        welcomed_within=round(greeted, 3),
        accepted=accepted,
        refused=len(answers) - accepted - unanswered,
        unanswered=unanswered,
    )


def _connect(endpoint: str, config: TransportConfig, actors: int) -> list[Joiner]:
    def join(number: int) -> Joiner | None:
        try:
            session = open_connecting(endpoint, config, CONNECT_SECONDS)
        except UnreachableError:
            return None
        return Joiner(f"storm-{number:03d}", secrets.token_hex(8), session)

    with ThreadPoolExecutor(AT_ONCE) as pool:
        joiners = [joiner for joiner in pool.map(join, range(actors)) if joiner is not None]
    if not joiners:
        raise UserError(f"no learner answers at {endpoint}")
    return joiners


def _take_welcome(joiner: Joiner, book: Book) -> bool:
    """Read the answer to a hello and send the chunk; whether it was a welcome."""
    sample = first_answer(joiner.channel)
    if sample is None:
        return False
    try:
        welcome, _ = decode(sample.payload.to_bytes(), Welcome)
        run = parse_config(welcome.config, "configuration from the learner")
    except (ValueError, UserError):
        return False
    draw = np.random.default_rng(welcome.actor_index)
    arrays = forged_arrays(run, draw, 1, max(0, welcome.weights_version))
    steps = run.actor.horizon
    header = forged_header(welcome.run_id, joiner.actor_id, joiner.life, 1, steps)
    joiner.entry = Entry(joiner.actor_id, joiner.life, 1, encode(header, arrays), steps)
    book.note("produced", joiner.entry, samples=steps)
    _send(joiner)
    return True


def _send(joiner: Joiner) -> None:
    assert joiner.entry is not None
    key = f"{UPLOAD}/{joiner.actor_id}/{joiner.life}/1"
    joiner.channel = joiner.session.ask(key, joiner.entry.payload, ANSWER_SECONDS)


def _settle(joiners: list[Joiner], book: Book, deadline: float) -> None:
    """Wait for every acknowledgement, sending again what was not answered, until ``deadline``."""
    waiting = list(joiners)
    while waiting and time.monotonic() < deadline:
        for joiner in waiting:
            sample = first_answer(joiner.channel)
            status = ""
            if sample is not None:
                status = decode(sample.payload.to_bytes(), Ack)[0].status
            if status in ("", "pause"):
                if time.monotonic() >= deadline:
                    return
                _send(joiner)
                continue
            joiner.answer = status
            assert joiner.entry is not None
            book.note("settled", joiner.entry, status=status)
        waiting = [joiner for joiner in waiting if not joiner.answer]


def main(arguments: Sequence[str] | None = None) -> int:
    """One storm from the command line; prints its report as JSON."""
    parser = argparse.ArgumentParser(prog="python -m lndrl.chaos.storm", description=__doc__)
    parser.add_argument("--connect", required=True)
    parser.add_argument("--actors", type=int, default=300)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--ledger", type=Path, required=True)
    options = parser.parse_args(arguments)
    try:
        report = storm(options.connect, options.actors, options.seconds, options.ledger)
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    print(json.dumps(asdict(report)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
