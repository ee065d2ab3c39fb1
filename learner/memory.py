"""Allocator settings for training on the CPU."""

from __future__ import annotations

import ctypes
import sys

_M_TRIM_THRESHOLD = -1
_M_MMAP_MAX = -4
_M_ARENA_MAX = -8


def keep_freed_memory() -> bool:
    """Tell glibc to keep freed memory for the next update instead of returning it.

    Activations of hundreds of megabytes are allocated and freed at every step; by default each
    comes fresh from the kernel, and a third of the time goes into page faults. Returns whether
    the setting took; other C libraries are left alone.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL("libc.so.6").mallopt
    except (OSError, AttributeError):
        return False
    # One arena: the arenas of threads are mapped in small pieces and given back all the same.
    settings = ((_M_MMAP_MAX, 0), (_M_TRIM_THRESHOLD, -1), (_M_ARENA_MAX, 1))
    return all([bool(mallopt(option, value)) for option, value in settings])
