"""Work in processes of its own: an error of CUDA spoils one for good, and a hang ends by force."""

from __future__ import annotations

import multiprocessing
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any

from lndrl import kernels
from lndrl.bench.gpu.parts import OutOfTimeError, Tell, sentence
from lndrl.errors import UserError
from lndrl.machine.signals import starting_child

Work = tuple[Callable[..., None], tuple[Any, ...]]
"""``function(tell, *arguments)``, importable by name, and ``arguments`` that can be pickled."""

_TOLD, _FAILED, _DONE = range(3)
_TRACE = 15  # lines of a traceback that are kept
_LEAVING = 5.0  # s


def apart(tell: Tell, deadline: float, *works: Work) -> None:
    """Do ``works`` side by side in a process each until all are done; none is left afterwards.

    Raises OutOfTimeError at ``deadline`` (s of ``time.monotonic``) and UserError with what one of
    them said, once all have ended.
    """
    processes: dict[Connection, SpawnProcess] = {}
    failures: list[str] = []
    try:
        for work in works:
            # The parent alone hears Ctrl-C, and ends them.
            with starting_child():
                connection, process = _start(work)
                processes[connection] = process
        busy = set(processes)
        while busy:
            ready = wait(list(busy), max(0.0, deadline - time.monotonic()))
            if not ready:
                raise OutOfTimeError("its time was up")
            for connection in (each for each in ready if isinstance(each, Connection)):
                if (failure := _hear(connection, processes[connection], tell)) is not None:
                    busy.discard(connection)
                    failures += [failure] if failure else []
    finally:
        for connection, process in processes.items():
            connection.close()
            process.kill()
            process.join()
    if failures:
        raise UserError("; ".join(failures))


def compiled() -> int:
    """How many kernels this process has compiled itself instead of finding them."""
    return sum(sum(k.stats.cache_misses.values()) for k in kernels.expected().values())


def _start(work: Work) -> tuple[Connection, SpawnProcess]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(theirs, *work), name="lndrl-bench", daemon=True)
    process.start()
    theirs.close()
    return ours, process


def _hear(connection: Connection, process: SpawnProcess, tell: Tell) -> str | None:
    """Take one message; None while there will be more, else how it failed, "" where it did not."""
    try:
        kind, value, keys = connection.recv()
    except (EOFError, ConnectionResetError):
        process.join(_LEAVING)
        return f"its process died with exit code {process.exitcode}"
    if kind == _TOLD:
        tell(value, *keys)
        return None
    if kind == _DONE:
        process.join(_LEAVING)
        return ""
    return str(value)


def _serve(connection: Connection, function: Callable[..., None], arguments: Sequence[Any]) -> None:
    def tell(value: Any, *keys: str) -> None:
        connection.send((_TOLD, value, keys))

    with suppress(BrokenPipeError, ConnectionResetError):
        try:
            function(tell, *arguments)
            connection.send((_DONE, None, ()))
        except Exception as error:
            if not isinstance(error, UserError):
                tell(traceback.format_exc().splitlines()[-_TRACE:], "trace")
            connection.send((_FAILED, sentence(error), ()))
