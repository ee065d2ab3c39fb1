"""Tasks spread over spawned worker processes that never outlive their parent.

Written out rather than left to ``concurrent.futures`` because a task reports many results while
it runs, a dead worker must end in a sentence, and Ctrl-C must stop workers in mid-task.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import nullcontext, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any

from lndrl import kernels
from lndrl.ahead import compiling_ahead
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.extensions import trust_modules, trusted_modules
from lndrl.machine.signals import starting_child

Work = Callable[[Any], Iterable[Any]]
"""What a worker does with one task: yields results."""

_RESULT, _FINISHED, _USER_ERROR, _COMPILING = range(4)
_JOIN_SECONDS = 2.0


def run_tasks(
    make_work: Callable[..., Work],
    arguments: Sequence[Any],
    tasks: Iterable[Any],
    workers: int,
    config: RunConfig | None = None,
) -> Generator[Any, None, None]:
    """Yield the results of all tasks in the order in which they become ready.

    ``make_work(*arguments)`` is called once per worker process and returns what it does with a
    task; with ``workers`` 0 everything runs in this process. All of it must be importable by
    name and picklable. However the iteration ends (exhausted, abandoned, Ctrl-C, an error), no
    worker is left. Worlds of ``config`` are what workers step, if it is given: of kernels that are
    missing this process compiles a part.

    Raises UserError when a worker raises it or dies.
    """
    if workers == 0:
        work = make_work(*arguments)
        for task in tasks:
            yield from work(task)
        return
    processes: dict[Connection, SpawnProcess] = {}
    try:
        for _ in range(workers):
            # Ctrl-C goes to the whole process group, a terminal's end and other people's kill may
            # as well: none reaches a worker, whose end is up to this process, which must know it.
            with starting_child():
                connection, process = _start(make_work, arguments)
                processes[connection] = process
        with nullcontext() if config is None else compiling_ahead(config, training=False):
            yield from _collect(processes, iter(tasks))
    finally:
        _stop(processes)


def _start(
    make_work: Callable[..., Work], arguments: Sequence[Any]
) -> tuple[Connection, SpawnProcess]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    # daemon: an exit of this program by any other way stops the workers as well.
    process = context.Process(
        target=_serve,
        args=(theirs, trusted_modules(), make_work, arguments),
        name="lndrl-evaluate",
        daemon=True,
    )
    process.start()
    theirs.close()
    return ours, process


def _serve(
    connection: Connection,
    trusted: Sequence[str],
    make_work: Callable[..., Work],
    arguments: Sequence[Any],
) -> None:
    """The worker's life: tasks in, results out, until the parent closes its end or dies."""
    trust_modules(*trusted)
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        try:
            with kernels.told(lambda *progress: connection.send((_COMPILING, progress))):
                work = make_work(*arguments)
                while True:
                    for result in work(connection.recv()):
                        connection.send((_RESULT, result))
                    connection.send((_FINISHED, None))
        except UserError as error:
            connection.send((_USER_ERROR, str(error)))


def _collect(processes: dict[Connection, SpawnProcess], tasks: Iterator[Any]) -> Iterator[Any]:
    busy: set[Connection] = set()
    for connection in processes:
        _hand_out(connection, tasks, busy, processes)
    while busy:
        for ready in wait(list(busy)):
            assert isinstance(ready, Connection)
            try:
                kind, value = ready.recv()
            except (EOFError, ConnectionResetError):
                raise _death(processes[ready]) from None
            if kind == _USER_ERROR:
                raise UserError(value)
            if kind == _RESULT:
                yield value
            elif kind == _COMPILING:
                kernels.tell(*value)
            else:
                busy.discard(ready)
                _hand_out(ready, tasks, busy, processes)


def _hand_out(
    connection: Connection,
    tasks: Iterator[Any],
    busy: set[Connection],
    processes: dict[Connection, SpawnProcess],
) -> None:
    for task in tasks:
        try:
            connection.send(task)
        except (BrokenPipeError, ConnectionResetError):
            raise _death(processes[connection]) from None
        busy.add(connection)
        return


def _death(process: SpawnProcess) -> UserError:
    process.join(_JOIN_SECONDS)
    code = process.exitcode
    if code is not None and code < 0:
        how = f"killed by {signal.Signals(-code).name}"
        mend = "free memory or use fewer --workers" if code == -signal.SIGKILL else "run it again"
    else:
        how, mend = f"exit code {code}", "its message stands above"
    return UserError(f"evaluation worker {process.pid} died ({how}); {mend}")


def _stop(processes: dict[Connection, SpawnProcess]) -> None:
    for connection, process in processes.items():
        connection.close()
        process.kill()  # it holds nothing that it would have to put away
    for process in processes.values():
        process.join()
