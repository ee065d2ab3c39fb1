"""The ranks of a learner on one machine: this process leads, the others are its children."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from datetime import timedelta
from pathlib import Path

import torch.distributed as dist

from learner.ppo.team import HERE, TIMEOUT, Team, stay_on_this_machine
from lndrl.errors import UserError
from lndrl.machine.signals import starting_child

_LOOPBACK = "127.0.0.1"
_LOOK = 0.05  # s
_PATIENCE = 10.0  # s for a rank to end by itself


class LocalRanks:
    """Starts ranks 1 to ``size`` - 1 as ``python -m learner OPTIONS``; gives the team of all.

    They take everything else from rank 0, which is this process. None of them is left behind.
    Raises UserError where one ends before it has joined.
    """

    def __init__(self, size: int, options: Sequence[str] = ()) -> None:
        self._size = size
        self._options = list(options)
        self._children: list[subprocess.Popen[bytes]] = []
        self._team: Team | None = None

    def __enter__(self) -> Team:
        try:
            stay_on_this_machine(_LOOPBACK)
            wait = timedelta(seconds=TIMEOUT)
            store = dist.TCPStore(_LOOPBACK, 0, None, True, wait, wait_for_workers=False)
            for rank in range(1, self._size):
                self._start(rank, store.port)
            self._wait(store)
            self._team = Team(store, 0, self._size)
        except BaseException:
            self.__exit__()
            raise
        return self._team

    def __exit__(self, *_: object) -> None:
        if self._team is not None:
            self._team.close()
        deadline = time.monotonic() + (_PATIENCE if self._team is not None else 0.0)
        for child in self._children:
            for end in (None, child.terminate, child.kill):
                if end is not None:
                    end()
                with suppress(subprocess.TimeoutExpired):
                    child.wait(max(0.1, deadline - time.monotonic()) if end is None else 3.0)
                    break

    def _start(self, rank: int, port: int) -> None:
        # Where this program is a checkout, its children must find it, too.
        root = str(Path(__file__).resolve().parents[2])
        paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(paths),
            "RANK": str(rank),
            "WORLD_SIZE": str(self._size),
            "MASTER_ADDR": _LOOPBACK,
            "MASTER_PORT": str(port),
        }
        command = [sys.executable, "-m", "learner", *self._options]
        with starting_child():
            self._children.append(
                subprocess.Popen(
                    command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL
                )
            )

    def _wait(self, store: dist.Store) -> None:
        """Until all have joined."""
        names = [f"{HERE}/{rank}" for rank in range(1, self._size)]
        deadline = time.monotonic() + TIMEOUT
        while not store.check(names):
            for rank, child in enumerate(self._children, 1):
                if (code := child.poll()) is not None:
                    raise UserError(f"rank {rank} ended with exit code {code} before it had joined")
            if time.monotonic() > deadline:
                raise UserError(f"not all {self._size} ranks have joined within {TIMEOUT:g} s")
            time.sleep(_LOOK)
