"""A process that plays a part of the synthetic actors; its parent talks to it in JSON lines."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

FINISH = 60.0
"""s within which what is on its way must be answered in the end."""


@dataclass(frozen=True)
class Part:
    """Which actors a process plays: ``count`` from number ``first`` on; files are the row's.

    ``namespace``: of the host that they are on; empty for this one.
    """

    endpoint: str
    config: dict[str, Any]
    chunk: str
    book: str
    first: int
    count: int
    period: float
    namespace: str = ""


def main(part: Part, channel: Connection) -> None:
    """Join, then do what the parent says: begin, count, tell, fetch N, stop."""
    from lndrl.bench.fleet.crowd import Crowd
    from lndrl.chaos.wire import enter
    from lndrl.config import parse_config
    from lndrl.errors import UserError
    from lndrl.machine.files import raise_file_limit

    raise_file_limit()
    if part.namespace:
        enter(part.namespace)
    config = parse_config(part.config, "bench fleet")
    with np.load(part.chunk) as file:
        arrays = dict(file)
    try:
        crowd = Crowd(part.endpoint, config, arrays, part.first, part.count, part.period)
    except UserError as error:
        _tell(channel, "failed", str(error))
        return
    _tell(channel, "joined", crowd.newest)
    wanted = None
    try:
        while True:
            while channel.poll():
                word, *what = json.loads(channel.recv_bytes())
                if word == "begin":
                    crowd.begin()
                elif word == "count":
                    crowd.count(*what)
                elif word == "tell":
                    _tell(channel, "counted", crowd.accepted, crowd.latencies)
                elif word == "fetch":
                    wanted = what[0]
                    crowd.fetch()
                elif word == "stop":
                    settled = crowd.finish(FINISH)
                    crowd.write_book(Path(part.book))
                    _tell(channel, "stopped", settled)
                    return
            crowd.turn()
            if wanted is not None and crowd.hold(wanted):
                _tell(channel, "hold", wanted, time.monotonic())
                wanted = None
    except (EOFError, OSError):
        return  # the parent is gone
    finally:
        crowd.close()


def _tell(channel: Connection, kind: str, *what: Any) -> None:
    channel.send_bytes(json.dumps([kind, *what]).encode())
