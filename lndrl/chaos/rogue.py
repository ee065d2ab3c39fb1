"""An actor that collects honestly and sends badly: ``python -m lndrl.chaos.rogue``.

Its worlds, policy and book are those of every actor; what its sending side does to a message is
drawn from a seed. The learner must train on each chunk once whatever arrives, how often and when.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sys
import threading
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from actors.actor import Actor
from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.machine.signals import stop_handler
from lndrl.transport.ledger import Entry
from lndrl.transport.zenoh.actor import ZenohActor
from lndrl.transport.zenoh.session import ZenohSession

HABITS = ("duplicated", "dropped", "unheard", "delayed", "echoed", "truncated", "cut_behind")
LATEST = 3.0
"""s by which a message is delayed or echoed at most."""

LEAVE_WITHIN = 2.0


class Late:
    """The channel of a query that is only sent once somebody waits for its answer.

    Meanwhile the next chunk goes ahead, so this is also what puts messages out of order.
    """

    def __init__(self, seconds: float, send: Any) -> None:
        self._seconds, self._send = seconds, send
        self._channel: Any = None

    def recv(self) -> Any:
        """Wait, send, and receive an answer."""
        if self._channel is None:
            time.sleep(self._seconds)
            self._channel = self._send()
        return self._channel.recv()


class RogueEndpoint(ZenohActor):
    """Does to a ``share`` of its uploads what one of ``HABITS`` says; ``counts`` tells how often.

    duplicated: sent twice at once. dropped: not sent, until patience ends. unheard: sent, but the
    answer is thrown away. delayed: sent late, others overtake it. echoed: sent once more when it
    is long settled. truncated, cut_behind: a part of it is sent before or after it.
    ``keep_weights``: after its first weights of a learner it fetches no others.
    """

    def __init__(
        self,
        endpoint: str,
        config: TransportConfig | None = None,
        seed: int = 0,
        share: float = 0.4,
        keep_weights: bool = False,
    ) -> None:
        super().__init__(endpoint, config)
        self.counts: Counter[str] = Counter()
        self._draw = random.Random(f"rogue {seed}")
        self._share = share
        self._keep_weights = keep_weights
        self._weights_of = ""

    def fetch(self, version: int | None = None, timeout: float = 10.0) -> tuple[int, bytes]:
        """Weights, or for one that keeps its weights a timeout."""
        learner = self.newest()[1]
        if self._keep_weights and learner == self._weights_of:
            self.counts["old_weights"] += 1
            raise TimeoutError("this actor stays with its weights")
        found = super().fetch(version, timeout)
        self._weights_of = learner
        return found

    def _send(self, session: ZenohSession, entry: Entry) -> Any:
        if self._draw.random() >= self._share:
            return super()._send(session, entry)
        habit = self._draw.choice(HABITS)
        self.counts[habit] += 1
        part = entry.payload[: self._draw.randrange(len(entry.payload))]
        wait = self._draw.uniform(0.1, LATEST)
        if habit == "dropped":
            return None
        if habit == "delayed":
            return Late(wait, lambda: self._ask_now(session, entry))
        if habit == "truncated":
            self._ask_now(session, entry, part)
        channel = super()._send(session, entry)
        if habit == "duplicated":
            channel = super()._send(session, entry)
        elif habit == "unheard":
            channel = None
        elif habit == "echoed":
            self._later(LATEST + wait, session, entry, entry.payload)
        elif habit == "cut_behind":
            self._later(0.01 * wait, session, entry, part)
        return channel

    def _later(self, seconds: float, session: ZenohSession, entry: Entry, payload: bytes) -> None:
        def send() -> None:
            if not session.closing:
                self._ask_now(session, entry, payload)

        timer = threading.Timer(seconds, send)
        timer.daemon = True
        timer.start()

    def _ask_now(self, session: ZenohSession, entry: Entry, payload: bytes | None = None) -> Any:
        """The query for ``entry``, with other bytes where given; its answer may go unread."""
        sent = Entry(entry.actor_id, entry.incarnation, entry.sequence, payload or entry.payload)
        return super()._send(session, sent)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one rogue until the run is done or a signal asks to stop; ends the process."""
    parser = argparse.ArgumentParser(prog="python -m lndrl.chaos.rogue", description=__doc__)
    parser.add_argument("--connect", required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--share", type=float, default=0.4)
    parser.add_argument("--keep-weights", action="store_true")
    parser.add_argument("--ledger", type=Path, required=True)
    parser.add_argument("--counts", type=Path, required=True, help="JSON of what it did")
    options = parser.parse_args(arguments)
    stop = threading.Event()
    with stop_handler(lambda *_: stop.set()):
        # As every worker does: nothing beside zenoh's and torch's threads to wait for.
        os._exit(_play(options, stop))


def _play(options: argparse.Namespace, stop: threading.Event) -> int:
    """The rogue's whole life; returns its exit code."""
    endpoint = RogueEndpoint(
        options.connect, None, options.seed, options.share, options.keep_weights
    )
    watch = (stop, os.getppid(), endpoint, options.counts)
    threading.Thread(target=_watch, args=watch, daemon=True).start()
    code = 0
    try:
        endpoint.keep_book(options.ledger)
        name = "old" if options.keep_weights else "rogue"
        actor = Actor(
            endpoint, actor_id=f"{name}-{options.seed}", worlds=1, patient=True, alone=True
        )
        actor.run(stop)
    except UserError as error:
        print(error, file=sys.stderr, flush=True)
        code = 2
    finally:
        endpoint.close()
    _write(options.counts, endpoint)
    sys.stderr.flush()
    return code


def _watch(stop: threading.Event, parent: int, endpoint: RogueEndpoint, counts: Path) -> None:
    while not stop.wait(1.0):
        _write(counts, endpoint)
        if os.getppid() != parent:
            stop.set()
    time.sleep(LEAVE_WITHIN)
    _write(counts, endpoint)
    os._exit(0)


def _write(path: Path, endpoint: RogueEndpoint) -> None:
    path.write_text(json.dumps(dict(endpoint.counts)), encoding="utf-8")


if __name__ == "__main__":
    main()
