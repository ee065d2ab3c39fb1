"""What the processes of a sweep are started with."""

from __future__ import annotations

from pathlib import Path

import pytest

from lndrl.evaluation.sweep import Launcher
from lndrl.machine.cores import THREAD_VARIABLES
from tests.lndrl.evaluation.sweep.helpers_sweep import small_sweep


@pytest.fixture(autouse=True)
def four_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine of four cores on which nobody has set a number of threads."""
    monkeypatch.setattr("lndrl.evaluation.sweep.processes.usable_cores", lambda: 4)
    for name in THREAD_VARIABLES:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(("parallel", "threads"), [(2, "2"), (4, "1"), (8, "1")])
def test_runs_side_by_side_share_the_cores(tmp_path: Path, parallel: int, threads: str) -> None:
    _, folder = small_sweep(tmp_path)
    environment = Launcher(folder, 0, parallel).environment
    assert {environment[name] for name in THREAD_VARIABLES} == {threads}


def test_a_run_alone_has_all_cores(tmp_path: Path) -> None:
    _, folder = small_sweep(tmp_path)
    assert not set(THREAD_VARIABLES) & set(Launcher(folder, 0, 1).environment)


def test_a_number_of_threads_that_the_user_has_set_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    _, folder = small_sweep(tmp_path)
    environment = Launcher(folder, 0, 2).environment
    assert environment["OMP_NUM_THREADS"] == "3"
    assert environment["MKL_NUM_THREADS"] == "2"
