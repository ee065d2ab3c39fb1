"""Filters on laser logs of real buildings: who keeps track, and how far off.

The map is made of every second scan at the log's corrected poses, so it is as wrong as a robot's
own map is. A filter runs twice: it hears every scan, half of which the map was made of, or only
those that it was not made of, which are twice as far apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from lndrl.config import LaserConfig, LocalizationConfig, TaskConfig
from lndrl.errors import UserError
from lndrl.evaluation.localization.carmen import LaserLog, load_carmen
from lndrl.evaluation.localization.figures import errors, lost_ticks, rmse
from lndrl.evaluation.localization.surveys import survey
from lndrl.evaluation.localization.tables import Row, markdown_table, settings_text
from lndrl.evaluation.pool import Work, run_tasks
from lndrl.localization import AMCL, LikelihoodMap
from lndrl.randomness import Stream, stream_state
from lndrl.version import VERSION
from lndrl.wording import counted

HEARD = {"every scan": slice(None), "unseen scans": slice(1, None, 2)}
"""Which scans a filter hears; the map is made of the even ones."""
LOG_WORLD = 4_200_000_000
"""World id of the filters' draws, in no family of episodes."""
RESOLUTION = 0.05  # m


class LogTask(NamedTuple):
    """One replay of a log: which, with which seed of the filter."""

    log: int
    seed: int


@dataclass(frozen=True)
class LogPlan:
    """What is measured; settings by label."""

    logs: tuple[Path, ...]
    settings: Mapping[str, LocalizationConfig]
    seeds: int
    task: TaskConfig = field(default_factory=TaskConfig)

    def check(self) -> None:
        """Raise UserError for what cannot be measured, before any work."""
        if self.seeds < 1:
            raise UserError(f"{self.seeds} seeds give no figures; give 1 or more")
        for path in self.logs:
            if not path.is_file():
                raise UserError(f"--logs: {path} is no file")
        if len(set(self.logs)) < len(self.logs):
            raise UserError("--logs: one log is named twice")


@dataclass(frozen=True)
class LogOutcome:
    """One setting on one log with one seed.

    Errors in m; ``lost`` as for drives, ``lost_time`` the share of the heard scans at which it was.
    ``effective_share``: mean effective count over the count. ``microseconds``: median of an update.
    ``scans`` and ``length`` (m): how many were heard and how far the log goes.
    """

    log: str
    scans: int
    length: float
    setting: str
    heard: str
    seed: int
    lost: bool
    lost_time: float
    median: float
    rmse: float
    worst: float
    effective_share: float
    microseconds: float


@dataclass(frozen=True)
class LogReport:
    """What was found, in the plan's order of logs, then seeds, then settings."""

    plan: LogPlan
    outcomes: tuple[LogOutcome, ...]

    def cells(self) -> Iterator[list[LogOutcome]]:
        """The outcomes of all seeds by log, setting and what was heard."""
        grouped: dict[tuple[str, str, str], list[LogOutcome]] = {}
        for outcome in self.outcomes:
            key = outcome.log, outcome.setting, outcome.heard
            grouped.setdefault(key, []).append(outcome)
        yield from grouped.values()

    def to_dict(self) -> dict[str, Any]:
        """Plain types for JSON."""
        settings = self.plan.settings
        return {
            "program_version": VERSION,
            "logs": [path.name for path in self.plan.logs],
            "seeds": self.plan.seeds,
            "settings": {k: v.model_dump(mode="json") for k, v in settings.items()},
            "outcomes": [asdict(outcome) for outcome in self.outcomes],
        }


def measure_logs(
    plan: LogPlan, workers: int = 0, progress: Callable[[LogOutcome], None] | None = None
) -> LogReport:
    """Replay every log under every setting, as ``HEARD`` says, with every seed.

    ``workers`` processes share the replays, 0 keeps them in this one. Raises UserError for a log
    that cannot be read or has nothing to compare with.
    """
    plan.check()
    tasks = [LogTask(log, seed) for log in range(len(plan.logs)) for seed in range(plan.seeds)]
    found: dict[LogTask, list[LogOutcome]] = {task: [] for task in tasks}
    results = run_tasks(_make_work, (plan,), tasks, min(workers, len(tasks)))
    with closing(results):
        for task, outcome in results:
            found[task].append(outcome)
            if progress is not None:
                progress(outcome)
    return LogReport(plan, tuple(outcome for task in tasks for outcome in found[task]))


def _make_work(plan: LogPlan) -> Work:
    return _Worker(plan)


class _Worker:
    """Replays logs; keeps what belongs to the log at hand."""

    def __init__(self, plan: LogPlan) -> None:
        self._plan = plan
        self._number = -1

    def __call__(self, task: LogTask) -> Iterator[tuple[LogTask, LogOutcome]]:
        """Yield one outcome per setting and way of hearing."""
        if task.log != self._number:
            self._prepare(task.log)
        for label, amcl in self._filters.items():
            for heard in HEARD:
                yield task, replay_log(self._log, amcl, label, heard, task.seed, self._plan.task)

    def _prepare(self, number: int) -> None:
        self._number = number
        self._log = log = load_carmen(self._plan.logs[number])
        grid = survey(log.truth[::2], log.ranges[::2], log.bearings, log.farthest, RESOLUTION)
        farthest = min(log.farthest, float(np.nanmax(log.ranges)) + 1.0)
        laser = LaserConfig(beams=len(log.bearings), range_max=farthest)
        self._filters = {
            label: AMCL(LikelihoodMap.build(grid, config, laser), config, laser)
            for label, config in self._plan.settings.items()
        }


def replay_log(
    log: LaserLog, amcl: AMCL, label: str, heard: str, seed: int, task: TaskConfig
) -> LogOutcome:
    """``amcl``, told the first pose, on the scans of ``log`` that ``heard`` names."""
    part = HEARD[heard]
    truth, odometry, ranges = log.truth[part], log.odometry[part], log.ranges[part]
    state = stream_state(seed, LOG_WORLD, 0, Stream.LOCALIZATION)
    amcl.reset(truth[0], state, odometry[0])
    estimated, shares, seconds = np.zeros_like(truth), np.zeros(len(truth)), np.zeros(len(truth))
    for i in range(len(truth)):
        started = perf_counter()
        amcl.update(odometry[i], ranges[i], log.bearings)
        seconds[i] = perf_counter() - started
        estimated[i] = amcl.pose_estimated
        shares[i] = min(1.0, amcl.effective_count / amcl.count)
    position, yaw = errors(estimated, truth)
    lost = lost_ticks(position, yaw, task.lost_distance, task.lost_angle)
    return LogOutcome(
        log=log.name,
        scans=len(truth),
        length=log.length,
        setting=label,
        heard=heard,
        seed=seed,
        lost=bool(lost.any()),
        lost_time=float(lost.mean()),
        median=float(np.median(position)),
        rmse=rmse(position),
        worst=float(position.max()),
        effective_share=float(shares.mean()),
        microseconds=1e6 * float(np.median(seconds)),
    )


def log_rows(report: LogReport) -> tuple[Row, list[Row]]:
    """Head and rows of the table, as text: a row per log and setting."""
    ways = [(heard, name) for heard in HEARD for name in ("lost", "time lost", "median (m)")]
    head = ("log", "driven (m)", "scans", "setting", *(f"{h}: {n}" for h, n in ways), "N_eff / N")
    by_row: dict[tuple[str, str], dict[str, list[LogOutcome]]] = {}
    for cell in report.cells():
        by_row.setdefault((cell[0].log, cell[0].setting), {})[cell[0].heard] = cell
    rows: list[Row] = []
    for (log, setting), cells in by_row.items():
        texts: list[str] = []
        for heard in HEARD:
            each = cells[heard]
            texts += [
                f"{sum(o.lost for o in each)}/{len(each)}",
                f"{100.0 * float(np.mean([o.lost_time for o in each])):.1f} %",
                f"{float(np.median([o.median for o in each])):.3f}",
            ]
        every = cells[next(iter(HEARD))]
        share = f"{float(np.mean([o.effective_share for o in every])):.3f}"
        first = every[0]
        rows.append((log, f"{first.length:.0f}", str(first.scans), setting, *texts, share))
    return head, rows


def log_table(report: LogReport) -> Table:
    """What a terminal shows."""
    head, rows = log_rows(report)
    table = Table(title="filters on laser logs", title_justify="left")
    for i, name in enumerate(head):
        table.add_column(name, justify="left" if i in (0, 3) else "right")
    for row in rows:
        table.add_row(*row)
    return table


def log_markdown(report: LogReport, command: str, machine: str) -> str:
    """The generated part of the document."""
    plan = report.plan
    return "\n\n".join(
        [
            f"`{command}`",
            f"{counted(plan.seeds, 'seed')} of the filter per log; {machine}.",
            settings_text(plan.settings),
            "Lost: seeds that were ever more than "
            f"{plan.task.lost_distance:g} m or {plan.task.lost_angle:.3f} rad off, and the share "
            "of scans at which they were. Median error of all scans, median over seeds. N_eff / N: "
            "mean share of the particles that matter, hearing every scan.",
            markdown_table(*log_rows(report)),
        ]
    )
