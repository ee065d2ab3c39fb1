"""What glibc does with memory that is freed, and what a process holds."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

TRIM_THRESHOLD, TOP_PAD, MMAP_THRESHOLD, MMAP_MAX = -1, -2, -3, -4
"""Options of glibc's ``mallopt``."""

_LARGE = 16 * 2**20


def glibc() -> ctypes.CDLL | None:
    """The C library, where it is one whose allocator can be told what to do."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        library = ctypes.CDLL("libc.so.6")
        library.malloc.argtypes, library.malloc.restype = [ctypes.c_size_t], ctypes.c_void_p
        library.free.argtypes, library.free.restype = [ctypes.c_void_p], None
        return library if library.mallopt and library.malloc_trim else None
    except (OSError, AttributeError):
        return None


def return_large_blocks() -> bool:
    """Tell glibc to give blocks of 16 MB and more back to the system as soon as they are freed.

    By itself it keeps what is as large as anything that was freed before, up to 32 MB: each new set
    of weights would leave a hole of its size. Returns whether the setting took; other C libraries
    are left alone.
    """
    library = glibc()
    if library is None:
        return False
    options = MMAP_THRESHOLD, TRIM_THRESHOLD
    return all([bool(library.mallopt(option, _LARGE)) for option in options])


def return_what_is_free() -> bool:
    """Give back all whole pages that nothing lies in; whether there were any."""
    library = glibc()
    return library is not None and bool(library.malloc_trim(0))


def resident_megabytes(pid: int | str = "self") -> float:
    """Resident memory of a process in MB (2^20 bytes); 0 where there is none, or no Linux."""
    try:
        for line in Path(f"/proc/{pid}/status").read_text("utf-8").splitlines():
            if line.startswith("VmRSS:"):
                return float(line.split()[1]) / 1024.0
    except OSError:
        return 0.0
    return 0.0
