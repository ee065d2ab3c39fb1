"""Allocator settings for training on the CPU."""

from __future__ import annotations

import ctypes
import sys
import time
from collections.abc import Callable

_M_TRIM_THRESHOLD = -1
_M_TOP_PAD = -2
_M_MMAP_MAX = -4

_HEAP = 64 * 2**20
"""Bytes of the pieces that arenas of threads are made of; a pad as large keeps an empty one."""


def keep_freed_memory() -> bool:
    """Tell glibc to keep freed memory for the next update instead of returning it.

    Activations of hundreds of megabytes are allocated and freed at every step; by default each
    comes fresh from the kernel, and a third of the time goes into page faults. Returns whether
    the setting took; other C libraries are left alone.
    """
    library = _glibc()
    if library is None:
        return False
    # Not one arena for all: what zenoh's threads leave behind would lie among the activations,
    # which touch it again as soon as it was given back.
    settings = ((_M_MMAP_MAX, 0), (_M_TRIM_THRESHOLD, -1), (_M_TOP_PAD, _HEAP))
    return all([bool(library.mallopt(option, value)) for option, value in settings])


def return_freed_memory() -> bool:
    """Give back to the system what is free now, wherever it lies; returns whether there was any.

    Takes milliseconds, and the next update's page faults once.
    """
    library = _glibc()
    return library is not None and bool(library.malloc_trim(0))


class MemoryTide:
    """Returns freed memory every ``interval`` s, so that what one peak took is not held for ever.

    Where freed memory is kept, a crowd of actors that came and went leaves its buffers behind.
    """

    def __init__(self, interval: float = 60.0, clock: Callable[[], float] = time.monotonic) -> None:
        self._interval = interval
        self._clock = clock
        self._last = clock()

    def turn(self) -> bool:
        """Call it often, where nothing large is allocated; whether memory was returned now."""
        if self._clock() - self._last < self._interval:
            return False
        self._last = self._clock()
        return return_freed_memory()


def _glibc() -> ctypes.CDLL | None:
    if not sys.platform.startswith("linux"):
        return None
    try:
        library = ctypes.CDLL("libc.so.6")
        return library if library.mallopt and library.malloc_trim else None
    except (OSError, AttributeError):
        return None
