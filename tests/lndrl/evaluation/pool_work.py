"""Work for test_pool.py in a module that spawned workers can import by name."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

from lndrl import kernels
from lndrl.errors import UserError
from lndrl.evaluation.pool import Work


def squares(offset: int) -> Work:
    def work(task: int) -> Iterator[tuple[int, int, int]]:
        for _ in range(2):
            yield task, task * task + offset, os.getpid()

    return work


def failing(how: str) -> Work:
    def work(task: int) -> Iterator[int]:
        yield task
        if how == "user":
            raise UserError("the scenario has no door")
        if how == "exit":
            os._exit(3)
        os.kill(os.getpid(), signal.SIGKILL)

    return work


def sleeping(seconds: float) -> Work:
    def work(task: int) -> Iterator[int]:
        yield os.getpid()
        time.sleep(seconds)

    return work


def compiling(needed: int) -> Work:
    def work(task: int) -> Iterator[int]:
        kernels.tell(task, needed)
        yield task

    return work
