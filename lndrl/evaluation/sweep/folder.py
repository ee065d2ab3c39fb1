"""Folders of several runs: what these left there, and so how far they are.

configs/RUN.yaml   what the run was started with, complete
runs/RUN/          the run folder that lndrl train makes; evaluation.json beside its records
logs/RUN.log       what its processes said
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol

from lndrl.config import RunConfig, load_config
from lndrl.errors import UserError
from lndrl.evaluation.result import EvaluationResult, load_result
from lndrl.evaluation.run_metrics import read_metrics
from lndrl.evaluation.sweep.spec import Sweep
from lndrl.machine.lock import check_free, held
from lndrl.numbering import checkpoints_in

State = Literal["missing", "begun", "diverged", "finished"]

_DIVERGED = re.compile(r"^\S+ \S+ diverged ", re.MULTILINE)


class Run(Protocol):
    """A run that is planned: its folder's name and its configuration."""

    @property
    def name(self) -> str:
        """Name of its folder."""

    @property
    def config(self) -> RunConfig:
        """What it is trained with, complete."""


class RunsFolder:
    """``runs`` in the folder ``path``; nothing is made before ``prepare``.

    ``aside`` (``path`` by default) is where configurations and logs are kept.
    """

    WORK: ClassVar[tuple[str, str]] = "runs", "wait for them"
    """Whose folder it is, and what to do while it is held."""

    def __init__(self, path: Path, runs: Sequence[Run], aside: Path | None = None) -> None:
        self.path = path.resolve()
        self.runs = tuple(runs)
        self.aside = (aside or path).resolve()

    def run_path(self, run: Run) -> Path:
        """The run's folder."""
        return self.path / "runs" / run.name

    def config_path(self, run: Run) -> Path:
        """What the run is started with."""
        return self.aside / "configs" / f"{run.name}.yaml"

    def log_path(self, run: Run) -> Path:
        """What the run's processes say."""
        return self.aside / "logs" / f"{run.name}.log"

    def is_complete(self, run: Run) -> bool:
        """Whether the run, trained to its end, needs nothing else."""
        return True

    def early(self, run: Run) -> str:
        """Why a finished run ended before its steps; empty where it did not."""
        return ""

    def state(self, run: Run) -> State:
        """How far the run is; without a checkpoint there is nothing to go on from."""
        folder = self.run_path(run)
        if _finished(folder / "summary.json"):
            return "finished"
        if not checkpoints_in(folder / "checkpoints"):
            return "missing"
        try:
            events = (folder / "events.log").read_text("utf-8")
        except (OSError, UnicodeDecodeError):
            events = ""
        return "diverged" if _DIVERGED.search(events) else "begun"

    def rows(self, run: Run) -> list[dict[str, Any]]:
        """The run's metrics, none before its first update."""
        path = self.run_path(run) / "metrics.jsonl"
        # A learner makes the file before it has a row.
        return read_metrics(path) if path.exists() and path.stat().st_size else []

    def steps(self, run: Run) -> int:
        """Environment steps that the run has learned from."""
        try:
            rows = self.rows(run)
        except UserError:  # its first line is being written
            return 0
        return int(rows[-1]["steps"]) if rows else 0

    def prepare(self, run: Run) -> Path:
        """Clear what cannot be resumed and write the run's configuration; returns its path.

        Raises UserError where somebody else trains that run.
        """
        place = self.run_path(run)
        check_free(place, "a learner", "stop it, or wait for it")
        shutil.rmtree(place, ignore_errors=True)
        path = self.config_path(run)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(run.config.to_yaml(), encoding="utf-8")
        except OSError as error:
            raise UserError(f"{path}: cannot be written ({error.strerror})") from None
        return path

    @contextmanager
    def locked(self) -> Iterator[int]:
        """Hold the folder against others who work there; yields the lock's descriptor.

        A process that inherits the descriptor holds the lock as well, so that a run which has
        survived whoever started it is not started a second time. Raises UserError where it is held.
        """
        whose, advice = self.WORK
        with held(self.aside, f"{whose}, or a run of it,", advice) as lock:
            yield lock.fileno()


class SweepFolder(RunsFolder):
    """The folder ``path`` of ``sweep``."""

    WORK = "a sweep", "wait for it or choose another --folder"

    def __init__(self, path: Path, sweep: Sweep) -> None:
        super().__init__(path, sweep.runs())
        self.sweep = sweep

    def evaluation_path(self, run: Run) -> Path:
        """The JSON of the final policy's evaluation."""
        return self.run_path(run) / "evaluation.json"

    def is_complete(self, run: Run) -> bool:
        """Whether the run was tested as the sweep asks for."""
        return not self.sweep.spec.episodes or self.evaluation(run) is not None

    def evaluation(self, run: Run) -> EvaluationResult | None:
        """The evaluation that the sweep asks for; None where it was not made, or otherwise."""
        spec = self.sweep.spec
        path = self.evaluation_path(run)
        if not spec.episodes or not path.exists():
            return None
        result = load_result(path)
        wanted = (spec.episodes, "greedy" if spec.greedy else "sampled")
        return result if (len(result.records), result.actions) == wanted else None

    def check(self) -> None:
        """Raise UserError for a run that was started with another configuration."""
        for run in self.sweep.runs():
            if self.state(run) == "missing":
                continue
            kept = self.config_path(run)
            if not kept.exists() or load_config(kept) != run.config:
                raise UserError(
                    f"{self.run_path(run)} was not trained with what {self.sweep.file} says of "
                    f"{run.variant.name} now; delete it or choose another --folder"
                )


def _finished(summary: Path) -> bool:
    try:
        return json.loads(summary.read_text("utf-8")).get("finished") is True
    except (OSError, ValueError, AttributeError):
        return False
