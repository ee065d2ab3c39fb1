"""Freed memory is kept for the next update, and given back now and then."""

import subprocess
import sys
import textwrap

import pytest

from learner import memory
from learner.memory import MemoryTide

START = """
    import ctypes, resource, threading
    from pathlib import Path
    from learner.memory import keep_freed_memory, return_freed_memory

    libc = ctypes.CDLL("libc.so.6")
    libc.malloc.restype = ctypes.c_void_p
    libc.free.argtypes = [ctypes.c_void_p]
    assert keep_freed_memory()

    def taken(count, size):
        pieces = [libc.malloc(size) for _ in range(count)]
        for piece in pieces:
            ctypes.memset(ctypes.c_void_p(piece), 1, size)
        return pieces

    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20
"""

PEAK = """
    before = resident()
    pieces = taken(2000, 100_000)
    for piece in pieces[:-1]:  # the last one holds the heap's top where it is
        libc.free(piece)
    kept = resident() - before
    given = return_freed_memory()
    print(kept, resident() - before, given)
"""

PEAK_OF_A_THREAD = """
    from concurrent.futures import ThreadPoolExecutor

    pool = ThreadPoolExecutor(1)

    def peak():
        for piece in taken(500, 100_000):  # less than the 64 MB of one heap
            libc.free(piece)

    pool.submit(peak).result()
    before = resident()
    return_freed_memory()
    kept = before - resident()
    return_freed_memory(lambda work: pool.submit(work).result())
    print(kept, before - resident())
"""

AGAIN = """
    def faults():
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

    def work():
        marks = [faults()]
        for _ in range(3):
            for piece in taken(8, 30 * 2**20):
                libc.free(piece)
            marks.append(faults())
        print(*(after - before for before, after in zip(marks, marks[1:])))

    return_freed_memory(lambda work: work())  # what it changes meanwhile is as before
"""
IN_A_THREAD = """
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
"""


def figures(code: str) -> list[str]:
    """What ``code`` prints in a process of its own."""
    whole = textwrap.dedent(START) + textwrap.dedent(code)
    done = subprocess.run([sys.executable, "-c", whole], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's allocator")
def test_a_peak_is_kept_until_it_is_given_back() -> None:
    kept, left, given = figures(PEAK)
    assert float(kept) > 150.0  # MiB of 190
    assert float(left) < 20.0
    assert given == "True"


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's allocator")
def test_the_end_of_a_threads_arena_goes_back_in_that_thread() -> None:
    without, with_thread = map(float, figures(PEAK_OF_A_THREAD))
    assert without < 24.0  # MiB of 48
    assert with_thread > 40.0


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's allocator")
@pytest.mark.parametrize("where", ["    work()", IN_A_THREAD], ids=["main", "thread"])
def test_what_was_freed_costs_no_page_faults_again(where: str) -> None:
    """Networks learn in threads; the pieces that their arenas consist of are kept, too."""
    first, *others = map(int, figures(AGAIN + where))
    assert first > 50_000  # 240 MiB in pages of 4 KiB
    assert max(others) < first / 50


class Clock:
    """Shows what it is set to."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_memory_is_returned_once_an_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    returned: list[float] = []

    def give(each_thread: object) -> bool:
        returned.append(clock.now)
        return True

    monkeypatch.setattr(memory, "return_freed_memory", give)
    tide = MemoryTide(interval=60.0, clock=clock)
    for clock.now in (100.0, 159.0, 160.0, 161.0, 219.0, 300.0, 301.0):
        assert tide.turn() == (clock.now in (160.0, 300.0))
    assert returned == [160.0, 300.0]
