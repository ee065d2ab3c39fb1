"""Which run is next, and what becomes of runs that stop, fail or diverge; no real training."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from lndrl.errors import UserError
from lndrl.evaluation.sweep import Job, Progress, SweepFolder, Work, next_job
from lndrl.evaluation.sweep.processes import RealProcess
from lndrl.machine.lock import FolderLock
from tests.lndrl.evaluation.sweep.helpers_sweep import rows_of, small_sweep, write_run

ROWS = rows_of(["arrived", "lost"] * 50, 1000, 10)


class FakeProcess:
    """Ends at the third look, as ``state`` and with ``code``."""

    def __init__(self, fakes: Fakes, job: Job, state: str, code: int) -> None:
        self.fakes, self.job, self.state, self.code = fakes, job, state, code
        self.looks = 0
        self.interrupted = 0
        self.ended = False

    def poll(self) -> int | None:
        self.looks += 1
        if self.interrupted:
            write_run(self.fakes.folder, self.job.run, ROWS[:4], "begun")
            return 130
        if self.looks < 3:
            return None
        if self.job.kind == "evaluate":
            _write_evaluation(self.fakes.folder, self.job)
        elif self.state != "missing":
            write_run(self.fakes.folder, self.job.run, ROWS, self.state)
        return self.code

    def interrupt(self) -> None:
        self.interrupted += 1

    def end(self, grace: float) -> None:
        self.ended = True


class Fakes:
    """Launches fake processes; ``fates`` by run: (state, exit code) of each attempt."""

    def __init__(self, folder: SweepFolder, **fates: list[tuple[str, int]]) -> None:
        self.folder, self.fates = folder, fates
        self.jobs: list[str] = []
        self.processes: list[FakeProcess] = []

    def __call__(self, job: Job) -> FakeProcess:
        name = job.run.name
        self.jobs.append(f"{job.kind} {name}")
        fates = self.fates.get(name.replace("-", "_"), [])
        state, code = fates.pop(0) if fates else ("finished", 0)
        self.processes.append(FakeProcess(self, job, state, code))
        return self.processes[-1]


def _write_evaluation(folder: SweepFolder, job: Job) -> None:
    record = {
        "world": 0, "episode": 0, "outcome": "arrived", "steps": 10, "time": 4.0, "distance": 2.0,
        "position_error": 0.1, "angle_error": 0.1, "variance_sum": 0.1, "episode_return": 1.0,
    }  # fmt: skip
    parts = dict.fromkeys(("approach", "pose", "arrive", "collide", "lost", "step"), 0.0)
    count = folder.sweep.spec.episodes
    data = {
        "planner": "p", "scenario": "room", "localization": "amcl", "actions": "sampled",
        "seed": 0, "config_hash": "x", "program_version": "1",
        "records": [{**record, "reward_parts": parts}] * count,
    }  # fmt: skip
    folder.evaluation_path(job.run).write_text(json.dumps(data))


def work(folder: SweepFolder, fakes: Fakes, parallel: int = 1, **hooks: object) -> Work:
    return Work(folder, fakes, parallel, tick=0.001, **hooks)  # type: ignore[arg-type]


def test_finished_runs_are_skipped_and_half_done_ones_resumed(tmp_path: Path) -> None:
    sweep, folder = small_sweep(tmp_path)
    runs = sweep.runs()
    write_run(folder, runs[0], ROWS)
    write_run(folder, runs[1], ROWS[:3], "begun")
    (folder.run_path(runs[2])).mkdir()  # killed before its first checkpoint
    fakes = Fakes(folder)
    said: list[str] = []
    assert work(folder, fakes, say=said.append).go(threading.Event())
    assert fakes.jobs == [
        "resume one-s1", "train eight-s1", "train base-s2", "train one-s2", "train eight-s2",
    ]  # fmt: skip
    assert said[:2] == ["one-s1: resumed at step 300", "one-s1: done at step 1,000"]
    assert work(folder, again := Fakes(folder)).go(threading.Event())
    assert again.jobs == []


def test_stopping_asks_every_run_once_and_leaves_the_rest(tmp_path: Path) -> None:
    _, folder = small_sweep(tmp_path)
    fakes = Fakes(folder)
    stop = threading.Event()

    def show(progress: Progress) -> None:
        if any(job.run.name == "eight-s1" for job, _ in progress.active):
            stop.set()

    assert not work(folder, fakes, parallel=2, show=show).go(stop)
    assert fakes.jobs == ["train base-s1", "train one-s1", "train eight-s1", "train base-s2"]
    late = [process for process in fakes.processes if process.interrupted]
    assert [process.job.run.name for process in late] == ["eight-s1", "base-s2"]
    assert all(process.interrupted == 1 for process in late)
    assert all(folder.state(process.job.run) == "begun" for process in late)
    assert work(folder, again := Fakes(folder)).go(threading.Event())
    assert sorted(again.jobs[:2]) == ["resume base-s2", "resume eight-s1"]


def test_a_second_interrupt_leaves_no_process(tmp_path: Path) -> None:
    _, folder = small_sweep(tmp_path)

    def show(progress: Progress) -> None:
        raise KeyboardInterrupt

    fakes = Fakes(folder)
    with pytest.raises(KeyboardInterrupt):
        work(folder, fakes, parallel=3, show=show).go(threading.Event())
    assert len(fakes.processes) == 3 and all(process.ended for process in fakes.processes)


def test_a_run_that_fails_is_tried_again_once(tmp_path: Path) -> None:
    _, folder = small_sweep(tmp_path)
    fakes = Fakes(folder, base_s1=[("begun", 1)], one_s1=[("missing", 2), ("missing", 2)])
    with pytest.raises(UserError, match=r"one-s1 failed twice, exit code 2: it said nothing"):
        work(folder, fakes).go(threading.Event())
    assert fakes.jobs == ["train base-s1", "resume base-s1", "train one-s1", "train one-s1"]


def test_a_diverged_run_is_a_result(tmp_path: Path) -> None:
    sweep, folder = small_sweep(tmp_path)
    fakes = Fakes(folder, one_s1=[("diverged", 2)])
    assert work(folder, fakes).go(threading.Event())
    assert len(fakes.jobs) == 6
    assert folder.state(sweep.runs()[1]) == "diverged"
    assert next_job(folder, sweep.runs()[1]) is None


def test_evaluation_follows_and_is_made_again_for_other_episodes(tmp_path: Path) -> None:
    _, folder = small_sweep(tmp_path, seeds=[1], episodes=3)
    assert work(folder, fakes := Fakes(folder)).go(threading.Event())
    assert fakes.jobs[:3] == ["train base-s1", "evaluate base-s1", "train one-s1"]
    _, more = small_sweep(tmp_path, seeds=[1], episodes=4)
    assert next_job(more, more.sweep.runs()[0]) == Job(more.sweep.runs()[0], "evaluate")
    _, none = small_sweep(tmp_path, seeds=[1])
    assert next_job(none, none.sweep.runs()[0]) is None


def test_progress_counts_what_is_left(tmp_path: Path) -> None:
    sweep, folder = small_sweep(tmp_path, seeds=[1])
    write_run(folder, sweep.runs()[0], ROWS)
    write_run(folder, sweep.runs()[1], ROWS[:3], "begun")
    progress = work(folder, Fakes(folder)).progress()
    assert (progress.done, progress.runs, progress.steps_left) == (1, 3, 700 + 1000)
    assert progress.rate is None and progress.seconds_left is None
    assert Progress(1, 3, 1700, 10.0, ()).seconds_left == 170.0


def test_runs_of_another_configuration_are_refused(tmp_path: Path) -> None:
    sweep, folder = small_sweep(tmp_path)
    write_run(folder, sweep.runs()[0], ROWS)
    folder.check()
    _, changed = small_sweep(tmp_path, steps=2000)
    with pytest.raises(UserError, match=r"base-s1 was not trained with .* says of base now"):
        changed.check()


def test_a_folder_serves_one_sweep_at_a_time(tmp_path: Path) -> None:
    _, folder = small_sweep(tmp_path)
    with (
        folder.locked(),
        pytest.raises(UserError, match="still at work there"),
        folder.locked(),
    ):
        pass
    with folder.locked():
        pass


def test_a_run_that_somebody_else_trains_is_not_cleared_away(tmp_path: Path) -> None:
    """Before its first checkpoint a run looks like one that never began."""
    sweep, folder = small_sweep(tmp_path)
    place = folder.run_path(sweep.runs()[0])
    place.mkdir(parents=True)
    with (
        FolderLock(place, "a learner", "stop it"),
        pytest.raises(UserError, match="base-s1: a learner is still at work there"),
    ):
        folder.prepare(sweep.runs()[0])
    assert place.is_dir()
    folder.prepare(sweep.runs()[0])
    assert not place.exists()


STUBBORN = """
import signal, subprocess, sys, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
print(child.pid, flush=True)
time.sleep(600)
"""


def test_a_process_that_does_not_listen_ends_with_its_children() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", STUBBORN], stdout=subprocess.PIPE, start_new_session=True
    )
    assert process.stdout is not None
    child = int(process.stdout.readline())
    RealProcess(process).end(grace=0.1)
    process.stdout.close()
    assert process.returncode == -signal.SIGKILL
    deadline = time.monotonic() + 60.0
    while _lives(child) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not _lives(child)


def _lives(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(") ")[1][0] != "Z"
    except OSError:
        return False
