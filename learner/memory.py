"""Allocator settings for training on the CPU."""

from __future__ import annotations

import time
from collections.abc import Callable

from lndrl.machine.memory import MMAP_MAX, TOP_PAD, TRIM_THRESHOLD, glibc, return_what_is_free

_HEAP = 64 * 2**20
"""Bytes of the pieces that arenas of threads are made of; a pad as large keeps an empty one."""

_ENOUGH = 2**17
"""Bytes whose freeing makes glibc look at an arena's end; it does from 64 kB on."""

EachThread = Callable[[Callable[[], None]], None]


def keep_freed_memory() -> bool:
    """Tell glibc to keep freed memory for the next update instead of returning it.

    Activations of hundreds of megabytes are allocated and freed at every step; by default each
    comes fresh from the kernel, and a third of the time goes into page faults. Returns whether
    the setting took; other C libraries are left alone.
    """
    library = glibc()
    if library is None:
        return False
    # Not one arena for all: what zenoh's threads leave behind would lie among the activations,
    # which touch it again as soon as it was given back.
    settings = ((MMAP_MAX, 0), (TRIM_THRESHOLD, -1), (TOP_PAD, _HEAP))
    return all([bool(library.mallopt(option, value)) for option, value in settings])


def return_freed_memory(each_thread: EachThread | None = None) -> bool:
    """Give back to the system what is free now; returns whether there was any.

    ``each_thread`` calls its argument in every thread whose peaks matter: the free end of a
    thread's own arena goes back only where that thread frees something. Takes milliseconds, and
    the next update's page faults once.
    """
    library = glibc()
    if library is None:
        return False
    if each_thread is not None:
        library.mallopt(TRIM_THRESHOLD, 0)
        library.mallopt(TOP_PAD, 0)
        try:
            each_thread(lambda: library.free(library.malloc(_ENOUGH)))
        finally:
            keep_freed_memory()
    return bool(library.malloc_trim(0))


class MemoryTide:
    """Returns freed memory every ``interval`` s, so that what one peak took is not held for ever.

    Where freed memory is kept, a crowd of actors that came and went leaves its buffers behind, and
    the largest of all batches what its activations took. Each return costs one update its page
    faults, so not after every one. ``each_thread``: see ``return_freed_memory``.
    """

    def __init__(
        self,
        each_thread: EachThread | None = None,
        interval: float = 15.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._each_thread = each_thread
        self._interval = interval
        self._clock = clock
        self._last = clock()
        return_what_is_free()  # first weights take twice their room while they are drawn

    def turn(self) -> bool:
        """Call it often, where nothing large is allocated; whether memory was returned now."""
        if self._clock() - self._last < self._interval:
            return False
        self._last = self._clock()
        return return_freed_memory(self._each_thread)
