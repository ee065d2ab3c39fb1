"""Jobs of sweeps that run in the process of the tests, which has torch already."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import pytest

from lndrl.cli.main import run
from lndrl.evaluation.sweep import Trainer
from lndrl.machine.threads import kept_threads


class Ended:
    """What is left of a process that has ended."""

    def __init__(self, code: int) -> None:
        self.returncode = code

    def poll(self) -> int:
        return self.returncode


def train_here(
    monkeypatch: pytest.MonkeyPatch, unless: Callable[[list[str]], bool] = lambda command: False
) -> None:
    """Let trainings of sweeps and of train-all be calls, but for commands that ``unless`` names.

    A process of its own takes longer to start than such a tiny training lasts.
    """
    start = Trainer._start

    def called(self: Trainer, command: list[str], out: Path, log: Path) -> Any:
        if unless(command):
            return start(self, command, out, log)
        with (
            log.open("a") as said,
            chdir(self._runs.path),
            kept_threads(),
            redirect_stdout(said),
            redirect_stderr(said),
        ):
            return Ended(run(command))

    monkeypatch.setattr(Trainer, "_start", called)
