"""How far the compiling of kernels is, for whoever waits a minute or two for a first start.

numba compiles a kernel when it is first called and keeps it for later starts; what is kept is not
compiled, and then nothing here has anything to say.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import CodeType
from typing import Any

from numba.core import event
from numba.core.dispatcher import Dispatcher

PACKAGE = "lndrl"
LINE_EVERY = 10.0
"""s between two lines of the log."""

Report = Callable[[int, int], None]
"""``report(ready, needed)``: how many of the kernels that are needed can be called."""
logger = logging.getLogger(PACKAGE)


class Lines:
    """A report that is a line at once, and then one every ``LINE_EVERY`` s."""

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say = say
        self._last = float("-inf")

    def __call__(self, ready: int, needed: int) -> None:
        """Say how far it is, if it is time to."""
        if time.monotonic() - self._last >= LINE_EVERY:
            self._last = time.monotonic()
            self._say(f"{words(ready, needed)}; only the first start on a machine does that")


def words(ready: int, needed: int) -> str:
    """How far it is, for people."""
    return f"compiling kernels, {ready} of {needed} ready"


class _Watch(event.Listener):
    """Hears of every kernel that numba compiles, one at a time: it holds a lock meanwhile."""

    def __init__(self) -> None:
        self.needed: dict[int, Any] = {}  # by identity
        self.reports: list[Report] = [Lines(logger.warning)]
        self.depth = 0

    def on_start(self, event: Any) -> None:
        """A kernel, or one that it calls, is about to be compiled."""
        kernel = event.data["dispatcher"]
        if _is_ours(kernel):
            if self.depth == 0:
                self.needed |= reached([kernel])
            tell(*self.progress())
        self.depth += 1

    def on_end(self, event: Any) -> None:
        """It is compiled."""
        self.depth -= 1
        if _is_ours(event.data["dispatcher"]):
            tell(*self.progress())

    def progress(self) -> tuple[int, int]:
        """How many are ready, of how many that are needed."""
        needed = dict(self.needed)
        # Of those that are kept it does not matter which process has compiled them.
        ready = reached(
            k for k in needed.values() if k.overloads or getattr(k._cache, "is_kept", False)
        )
        return len(needed.keys() & ready.keys()), len(needed)


_watch = _Watch()
event.register("numba:compile", _watch)


def expect(*kernels: Any) -> None:
    """Count ``kernels`` and all that they call among those that are needed.

    What nobody expected counts from when it is first called.
    """
    _watch.needed |= reached(kernels)


def expected() -> dict[int, Any]:
    """The kernels that are needed, as far as is known, by identity."""
    return dict(_watch.needed)


@contextmanager
def waiting() -> Iterator[Callable[[], None]]:
    """While another process compiles what is needed here; to be called now and then meanwhile."""
    _watch.depth += 1
    try:
        yield lambda: tell(*_watch.progress())
    finally:
        _watch.depth -= 1


def in_progress() -> tuple[int, int] | None:
    """How many kernels are ready, of how many, if one is being compiled at this moment."""
    return _watch.progress() if _watch.depth else None


@contextmanager
def told(report: Report) -> Iterator[None]:
    """Tell ``report`` instead of the log while this lasts, in the whole process.

    It is called from whichever thread compiles, which waits for it.
    """
    _watch.reports.append(report)
    try:
        yield
    finally:
        _watch.reports.remove(report)


def tell(ready: int, needed: int) -> None:
    """Report how far this process is, or one that works for it; never raises."""
    try:
        _watch.reports[-1](ready, needed)
    except Exception:
        logger.exception("how far kernels are could not be told")


def reached(kernels: Iterable[Any]) -> dict[int, Any]:
    """``kernels`` and whatever they call, less what is compiled as a part of its callers."""
    found: dict[int, Any] = {}
    seen: set[int] = set()
    waiting = list(kernels)
    while waiting:
        kernel = waiting.pop()
        if id(kernel) in seen:
            continue
        seen.add(id(kernel))
        if kernel.targetoptions.get("inline") != "always":
            found[id(kernel)] = kernel
        waiting += _called(kernel.py_func)
    return found


def _called(function: Any) -> Iterator[Any]:
    names: set[str] = set()
    codes: list[CodeType] = [function.__code__]
    while codes:
        code = codes.pop()
        names.update(code.co_names)
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    for value in (*(function.__globals__.get(name) for name in names), *cells):
        if isinstance(value, Dispatcher) and _is_ours(value):
            yield value


def _is_ours(kernel: Any) -> bool:
    return kernel.py_func.__module__.partition(".")[0] == PACKAGE
