"""Kernels: functions that numba compiles, where they are kept, and how far their compiling is.

``kernel`` makes one. ``expect`` names those that will be called; ``told`` and ``in_progress`` say
how far they are, for whoever waits a minute for a first start.
"""

from lndrl.kernels.decorator import kernel
from lndrl.kernels.store import KernelCache, is_kept
from lndrl.kernels.watch import (
    LINE_EVERY,
    Lines,
    Report,
    expect,
    expected,
    in_progress,
    reached,
    tell,
    told,
    words,
)

__all__ = [
    "LINE_EVERY",
    "KernelCache",
    "Lines",
    "Report",
    "expect",
    "expected",
    "in_progress",
    "is_kept",
    "kernel",
    "reached",
    "tell",
    "told",
    "words",
]
