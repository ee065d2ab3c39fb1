"""What glibc is told about freed memory, and what a process holds."""

from __future__ import annotations

import subprocess
import sys
import textwrap

import pytest

from lndrl.machine import memory
from lndrl.machine.memory import glibc, resident_megabytes

pytestmark = pytest.mark.skipif(glibc() is None, reason="glibc alone can be told")

HOLES = """
    import ctypes, sys
    from lndrl.machine.memory import resident_megabytes, return_large_blocks, return_what_is_free

    libc = ctypes.CDLL("libc.so.6")
    libc.malloc.restype = ctypes.c_void_p
    libc.free.argtypes = [ctypes.c_void_p]

    def taken(megabytes):
        piece = libc.malloc(megabytes * 2**20)
        ctypes.memset(ctypes.c_void_p(piece), 1, megabytes * 2**20)
        return piece

    if sys.argv[1] == "told":
        assert return_large_blocks()
    libc.free(taken(31))  # from now on glibc would keep blocks of that size
    before = resident_megabytes()
    first, second = taken(30), taken(1)  # the second lies above the hole that the first leaves
    libc.free(first)
    hole = resident_megabytes() - before - 1
    small = [libc.malloc(100_000) for _ in range(300)]
    for piece in small:
        ctypes.memset(ctypes.c_void_p(piece), 1, 100_000)
    for piece in small[:-1]:
        libc.free(piece)
    left = resident_megabytes()
    return_what_is_free()
    print(round(hole), left - resident_megabytes() > 20)
"""


@pytest.mark.parametrize(("told", "hole"), [("told", 0), ("not", 30)])
def test_large_blocks_leave_no_holes_and_small_ones_can_be_returned(told: str, hole: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(HOLES), told], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    found, returned = done.stdout.split()
    assert abs(int(found) - hole) <= 2 and returned == "True"


def test_other_libraries_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "glibc", lambda: None)
    assert not memory.return_large_blocks() and not memory.return_what_is_free()


def test_a_process_that_is_none_holds_nothing() -> None:
    assert resident_megabytes() > 10.0
    assert resident_megabytes(2**30) == 0.0
