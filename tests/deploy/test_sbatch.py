"""The Slurm script, run by bash as Slurm runs it, with a real learner and a real actor.

``srun`` and ``scontrol`` are what a machine without Slurm lacks: the first is replaced by running
the step here, the second by saying what was asked of it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import yaml

from lndrl.chaos.stage import CONFIG
from lndrl.evaluation.sweep.processes import this_program
from lndrl.machine.ports import free_port
from lndrl.machine.processes import descendants, lives

SCRIPT = Path(__file__).resolve().parents[2] / "deploy/slurm/train.sbatch"
PATIENCE = 300.0  # s, for machines with much else to do


class Job:
    """The script as a job in ``folder``."""

    def __init__(self, folder: Path) -> None:
        self.log = folder / "job.log"
        program = folder / "program"
        program.write_text(f'#!/bin/sh\nexec {sys.executable} -m lndrl "$@"\n')
        program.chmod(0o755)
        (folder / "small.yaml").write_text(yaml.safe_dump(CONFIG))
        environment = this_program() | {
            "LNDRL": str(program),
            "LNDRL_CONFIG": "small.yaml",
            "LNDRL_PORT": str(free_port()),
            "LNDRL_HOST": "localhost",
            "LNDRL_SRUN": "env OMP_NUM_THREADS=1",
            "LNDRL_REQUEUE": "echo requeue",
            "SLURM_JOB_ID": "42",
        }
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                ["bash", str(SCRIPT)], cwd=folder, env=environment, stdin=subprocess.DEVNULL,
                stdout=log, stderr=log, start_new_session=True,
            )  # fmt: skip

    def wait(self, done: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not done():
            assert self.process.poll() is None, self.said()
            assert time.monotonic() < deadline, self.said()
            time.sleep(0.1)

    def said(self) -> str:
        return self.log.read_text(errors="replace")

    def end(self, number: signal.Signals) -> int:
        pids = descendants(self.process.pid)
        self.process.send_signal(number)  # to the script alone, as --signal=B: says
        code = self.process.wait(PATIENCE)
        deadline = time.monotonic() + 30.0
        while any(map(lives, pids)):
            assert time.monotonic() < deadline, self.said()
            time.sleep(0.1)
        return code

    def kill(self) -> None:
        try:
            os.killpg(self.process.pid, signal.SIGKILL)
        except ProcessLookupError:
            return
        self.process.wait()


def rows(folder: Path) -> int:
    metrics = folder / "runs/first/metrics.jsonl"
    return len(metrics.read_text().splitlines()) if metrics.exists() else 0


def test_a_preempted_job_leaves_a_checkpoint_asks_for_another_turn_and_goes_on(
    tmp_path: Path,
) -> None:
    job = Job(tmp_path)
    try:
        job.wait(lambda: rows(tmp_path) > 0)
        assert job.end(signal.SIGUSR1) == 0, job.said()
    finally:
        job.kill()
    said, before = job.said(), rows(tmp_path)
    assert said.splitlines()[-1] == "requeue 42" and (tmp_path / "runs/first/summary.json").exists()
    again = Job(tmp_path)
    try:
        again.wait(lambda: rows(tmp_path) > before)
        assert again.end(signal.SIGTERM) != 0, again.said()
    finally:
        again.kill()
    assert "from step" in again.said()[len(said) :]
    assert again.said().count("requeue 42") == 1
