"""Freed memory is kept for the next update, and given back now and then."""

import subprocess
import sys
import textwrap

import pytest

from learner import memory
from learner.memory import MemoryTide

PEAK = """
    import ctypes
    from pathlib import Path
    from learner.memory import keep_freed_memory, return_freed_memory

    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20

    libc = ctypes.CDLL("libc.so.6")
    libc.malloc.restype = ctypes.c_void_p
    libc.free.argtypes = [ctypes.c_void_p]
    assert keep_freed_memory()
    before = resident()
    pieces = [libc.malloc(100_000) for _ in range(2000)]
    for piece in pieces:
        ctypes.memset(ctypes.c_void_p(piece), 1, 100_000)
    for piece in pieces[:-1]:  # the last one holds the heap's top where it is
        libc.free(piece)
    kept = resident() - before
    given = return_freed_memory()
    print(kept, resident() - before, given)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's allocator")
def test_a_peak_is_kept_until_it_is_given_back() -> None:
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(PEAK)], capture_output=True, text=True, check=True
    )
    kept, left, given = done.stdout.split()
    assert float(kept) > 150.0  # MiB of 190
    assert float(left) < 20.0
    assert given == "True"


class Clock:
    """Shows what it is set to."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_memory_is_returned_once_an_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    returned: list[float] = []

    def give() -> bool:
        returned.append(clock.now)
        return True

    monkeypatch.setattr(memory, "return_freed_memory", give)
    tide = MemoryTide(interval=60.0, clock=clock)
    for clock.now in (100.0, 159.0, 160.0, 161.0, 219.0, 300.0, 301.0):
        assert tide.turn() == (clock.now in (160.0, 300.0))
    assert returned == [160.0, 300.0]
