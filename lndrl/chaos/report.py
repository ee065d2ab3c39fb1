"""What a chaos run found, as JSON and as tables."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich import box
from rich.table import Table

from lndrl.chaos.faults import Findings
from lndrl.chaos.ledger import Balance
from lndrl.chaos.monitor import Monitor


@dataclass(frozen=True)
class ChaosReport:
    """A chaos run. Counts are samples; times are seconds; ``side`` is the second run's balance."""

    seed: int
    minutes: float
    found: Findings
    misbehaved: dict[str, int]
    main: Balance
    side: Balance | None
    memory_growth: float | None
    memory_by_fifth: list[float]
    handle_growth: int | None
    learner_life: float
    learner_starts: int
    checkpoints_refused: int
    tracebacks: int
    late: list[str]

    @property
    def lost(self) -> int:
        """Of both runs."""
        return self.main.lost + (self.side.lost if self.side else 0)

    @property
    def duplicated(self) -> int:
        """Of both runs."""
        return self.main.duplicated + (self.side.duplicated if self.side else 0)

    @property
    def contradictions(self) -> int:
        """Of both runs."""
        return self.main.contradictions + (self.side.contradictions if self.side else 0)

    @property
    def good(self) -> bool:
        """Whether the promise was kept, and something happened to keep it against."""
        bad = (self.lost, self.duplicated, self.contradictions, len(self.found.deaths))
        return not any(bad) and not self.found.orphans and self.main.trained > 0

    def to_dict(self) -> dict[str, Any]:
        """Plain data for ``--json``."""
        found, main = self.found, self.main
        return {
            "seed": self.seed,
            "minutes": round(self.minutes, 3),
            "faults": sum(found.struck.values()),
            "faults_by_kind": dict(sorted(found.struck.items())),
            "faults_that_met_nothing": dict(sorted(found.missed.items())),
            "messages_misused": dict(sorted(self.misbehaved.items())),
            **{key: value for key, value in asdict(main).items() if key != "examples"},
            "lost": self.lost,
            "duplicated": self.duplicated,
            "contradictions": self.contradictions,
            "examples": [*main.examples, *(self.side.examples if self.side else [])],
            "second_run": None if self.side is None else asdict(self.side),
            "recovery_seconds_max": _most(found.recoveries),
            "recovery_seconds": [round(value, 2) for value in found.recoveries],
            "frozen_shown_seconds_max": _most(found.frozen_shown),
            "frozen_shown": len(found.frozen_shown),
            "frozen_unseen": found.frozen_unseen,
            "others_rate_while_frozen": _median(found.others_while_frozen),
            "others_rates_while_frozen": [round(r, 3) for r in found.others_while_frozen],
            "memory_growth": self.memory_growth,
            "memory_megabytes_by_fifth": self.memory_by_fifth,
            "file_handle_growth": self.handle_growth,
            "learner_life_seconds": round(self.learner_life, 1),
            "learner_starts": self.learner_starts,
            "learner_deaths": found.deaths,
            "learner_tracebacks": self.tracebacks,
            "checkpoints_refused": self.checkpoints_refused,
            "steps_per_second": round(main.trained / max(60.0 * self.minutes, 1e-9), 1),
            "actors_gave_up": found.gave_up,
            "orphans": found.orphans,
            "killed_at_the_end": self.late,
            "join_storms": found.storms,
        }


def make_report(
    seed: int,
    minutes: float,
    found: Findings,
    monitor: Monitor,
    main: Balance,
    side: Balance | None,
    **rest: Any,
) -> ChaosReport:
    """Put together what the monitor saw and what the books say."""
    return ChaosReport(
        seed=seed,
        minutes=minutes,
        found=found,
        main=main,
        side=side,
        memory_growth=monitor.memory_growth(),
        memory_by_fifth=monitor.memory_by_fifth(),
        handle_growth=monitor.handle_growth(),
        learner_life=monitor.longest_life(),
        **rest,
    )


def report_tables(report: ChaosReport) -> list[Table]:
    """The ledger, the figures, and what happened."""
    data = report.to_dict()
    ledger = _table(f"ledger of {data['minutes']:g} min, seed {report.seed}", "samples")
    for name in ("produced", "acknowledged", "trained"):
        ledger.add_row(name, f"{data[name]:,}")
    for rule, samples in data["dropped_by_rule"].items():
        ledger.add_row(f"dropped: {rule}", f"{samples:,}")
    for name in ("refused", "unanswered", "accepted_again", "lost", "duplicated"):
        ledger.add_row(name.replace("_", " "), f"{data[name]:,}")
    figures = _table("figures", "")
    for name in (
        "faults", "contradictions", "recovery_seconds_max", "frozen_shown_seconds_max",
        "frozen_unseen", "others_rate_while_frozen", "memory_growth", "file_handle_growth",
        "steps_per_second",
        "learner_starts", "checkpoints_refused", "orphans",
    ):  # fmt: skip
        figures.add_row(name.replace("_", " "), _value(data[name]))
    figures.add_row("learner died of itself", str(len(report.found.deaths)))
    faults = _table("faults", "times")
    for source in (data["faults_by_kind"], data["messages_misused"]):
        for name, count in source.items():
            faults.add_row(name.replace("_", " "), f"{count:,}")
    return [ledger, figures, faults]


def _table(title: str, unit: str) -> Table:
    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left")
    table.add_column("")
    table.add_column(unit, justify="right")
    return table


def _value(value: float | int | None) -> str:
    if value is None:
        return "–"
    return f"{value:.3g}" if isinstance(value, float) else f"{value:,}"


def _median(values: Sequence[float]) -> float | None:
    return round(statistics.median(values), 3) if values else None


def _most(values: Sequence[float]) -> float | None:
    return round(max(values), 2) if values else None
