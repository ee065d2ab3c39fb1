"""A whole training as users start it, for benchmarks that watch one from outside."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from lndrl.config import REPOSITORY_CONFIGS
from lndrl.errors import UserError
from lndrl.evaluation.run_metrics import read_metrics
from lndrl.evaluation.sweep.processes import RealProcess, this_program
from lndrl.machine.memory import resident_megabytes
from lndrl.machine.ports import free_port

CONFIG = REPOSITORY_CONFIGS / "reward_alone.yaml"
WARM_UPDATES = 2
"""Updates that are not counted: compilation, first episodes."""

_STARTUP = 300.0  # s within which the first update must come
_LEAVING = 60.0  # s that an asked run may take for its last checkpoint
SETTINGS = ("ppo.epochs=4", "learner.validation_episodes=0")
"""Whatever lndrl.yaml finds best, the figure stays comparable."""

Rows = Sequence[dict[str, Any]]


class Training:
    """``lndrl train configs/reward_alone.yaml``, 4 epochs, in ``folder``; a context that ends it.

    Leads a session of its own, so that it can be paused and ended together with its actors.
    ``name`` is the benchmark's, for its errors; ``more`` goes to the command line; ``config`` and
    ``settings`` (key=value) are of another training than that. ``leaving``: s that it may take to
    end, for its last checkpoint.
    """

    def __init__(
        self,
        name: str,
        folder: Path,
        scheme: str,
        more: Sequence[str],
        config: Path = CONFIG,
        settings: Sequence[str] = SETTINGS,
        leaving: float = _LEAVING,
    ) -> None:
        self.name, self.folder = name, folder / "runs/bench"
        self._log, self._leaving = folder / "log", leaving
        command = [sys.executable, "-m", "lndrl", "train", str(config), "--run", "bench"]
        command += ["--no-dashboard", "--listen", f"{scheme}/127.0.0.1:{free_port()}"]
        command += [part for each in settings for part in ("--set", each)]
        command += more
        self._began = time.monotonic()
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                command,
                cwd=folder,
                env=this_program(),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def __enter__(self) -> Training:
        return self

    def __exit__(self, *_: object) -> None:
        self.go_on()
        RealProcess(self._process).end(self._leaving)

    def rows(self) -> list[dict[str, Any]]:
        """Its ``metrics.jsonl`` so far, a row per update."""
        try:
            return read_metrics(self.folder / "metrics.jsonl")
        except UserError:  # not yet written
            return []

    def curve(self) -> list[dict[str, Any]]:
        """What was validated so far, a row per version."""
        from lndrl.curve import read_curve

        return read_curve(self.folder / "metrics.jsonl")

    def wait(self, done: Callable[[Rows], bool], interval: float = 0.5) -> Rows:
        """The rows as soon as they are ``done``; looks every ``interval`` s.

        Raises UserError when the run ends, or does not get going.
        """
        while True:
            rows = self.rows()
            ended = self._process.poll() is not None
            if done(rows):
                return rows
            if ended:
                raise UserError(f"{self.name}: the run ended early, saying: {self._last_words()}")
            if len(rows) < WARM_UPDATES and time.monotonic() - self._began > _STARTUP:
                raise UserError(f"{self.name}: no update within {_STARTUP:.0f} s on this machine")
            time.sleep(interval)

    def pause(self) -> None:
        """Stop learner and actors where they are."""
        os.killpg(self._process.pid, signal.SIGSTOP)

    def go_on(self) -> None:
        """Undo ``pause``; does nothing to a run that goes on or has ended."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGCONT)

    def megabytes(self) -> tuple[float, float]:
        """Resident memory of the learner and of the actor that has most, in MB (2^20 bytes)."""
        pid = self._process.pid
        actors = [resident_megabytes(child) for child in _children(pid)]
        return resident_megabytes(pid), max([0.0, *actors])

    def _last_words(self) -> str:
        """The last line of what it printed."""
        lines = self._log.read_text("utf-8", "replace").split("\n")
        return next((each.strip() for each in reversed(lines) if each.strip()), "nothing")


def span(rows: Rows) -> float:
    """Seconds from the first row to the last."""
    return float(rows[-1]["time"]["unix"] - rows[0]["time"]["unix"])


def _children(pid: int) -> list[int]:
    try:
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text("utf-8")
    except OSError:
        return []
    return [int(child) for child in text.split()]
