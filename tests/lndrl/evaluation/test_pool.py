from __future__ import annotations

import importlib
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest

from lndrl import kernels
from lndrl.errors import UserError
from lndrl.evaluation.pool import run_tasks
from lndrl.machine.signals import STOP_SIGNALS

HERE = Path(__file__).parent
PARENT = """
import sys
sys.path[:0] = {path!r}
import pool_work
from lndrl.evaluation.pool import run_tasks

if __name__ == "__main__":
    for pid in run_tasks(pool_work.sleeping, ({seconds},), range(1), 1):
        print(pid, flush=True)
"""


@pytest.fixture
def pool_work(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(HERE))
    return importlib.import_module("pool_work")


@pytest.mark.parametrize("workers", [0, 2])
def test_every_task_runs_once_and_reports_all_results(pool_work: ModuleType, workers: int) -> None:
    results = list(run_tasks(pool_work.squares, (7,), range(5), workers))
    expected = [(k, k * k + 7) for k in range(5) for _ in range(2)]
    assert sorted(r[:2] for r in results) == expected
    assert {pid == os.getpid() for *_, pid in results} == {workers == 0}
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize(
    ("how", "sentence"),
    [("user", "no door"), ("exit", r"died \(exit code 3\)"), ("kill", r"killed by SIGKILL")],
)
def test_trouble_in_a_worker_ends_in_a_sentence(
    pool_work: ModuleType, how: str, sentence: str
) -> None:
    with pytest.raises(UserError, match=sentence):
        list(run_tasks(pool_work.failing, (how,), range(2), 1))
    assert multiprocessing.active_children() == []


def test_an_abandoned_iteration_leaves_no_worker(pool_work: ModuleType) -> None:
    results = run_tasks(pool_work.squares, (0,), range(100), 1)
    next(results)
    results.close()
    assert multiprocessing.active_children() == []


def test_what_a_whole_group_is_sent_does_not_reach_a_worker(pool_work: ModuleType) -> None:
    """It would die first, and its parent take the signal that comes to itself for its death."""
    results = run_tasks(pool_work.squares, (7,), range(40), 1)
    *_, worker = next(results)
    for number in STOP_SIGNALS:
        os.kill(worker, number)
    assert len(list(results)) == 79
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize(("stop", "seconds"), [(signal.SIGINT, 600), (signal.SIGKILL, 1)])
def test_no_worker_outlives_a_stopped_parent(
    tmp_path: Path, stop: signal.Signals, seconds: float
) -> None:
    """SIGINT goes to the whole group as a terminal sends it and stops workers in mid-task."""
    script = tmp_path / "parent.py"
    script.write_text(PARENT.format(path=[str(HERE), *sys.path], seconds=seconds))
    with subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as parent:
        assert parent.stdout is not None and parent.stderr is not None
        worker = int(parent.stdout.readline())
        send = os.killpg if stop == signal.SIGINT else os.kill
        send(parent.pid, stop)
        parent.wait(120)
        deadline = time.monotonic() + 120
        while _alive(worker) and time.monotonic() < deadline:
            time.sleep(0.02)
        assert not _alive(worker)
        # The parent's KeyboardInterrupt at most: workers stay silent.
        assert parent.stderr.read().count("Traceback") <= 1


def _alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


@pytest.mark.parametrize("workers", [0, 2])
def test_how_far_kernels_are_is_heard_from_workers(pool_work: ModuleType, workers: int) -> None:
    heard: list[tuple[int, int]] = []
    with kernels.told(lambda ready, needed: heard.append((ready, needed))):
        assert sorted(run_tasks(pool_work.compiling, (31,), range(3), workers)) == [0, 1, 2]
    assert sorted(heard) == [(0, 31), (1, 31), (2, 31)]
