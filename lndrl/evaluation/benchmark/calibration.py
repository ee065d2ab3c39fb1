"""How near variants of the bench come to the paper's DWA row, the only one that may be looked at.

Nobody has the paper's maps. What its text leaves open is chosen such that the classical baseline
fares here as it did there; learned policies are tested on the result, never before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator
from rich.table import Table

from lndrl.config import REPOSITORY_CONFIGS
from lndrl.evaluation.benchmark.figures import Row
from lndrl.evaluation.benchmark.paper import PAPER
from lndrl.evaluation.benchmark.spec import Contender
from lndrl.models import Count, Model, load_yaml, validate
from lndrl.planners import PlannerSource
from lndrl.planners.dwa import DWAConfig

CALIBRATION = REPOSITORY_CONFIGS / "calibration.yaml"
METHOD = "dwa"
JUDGED = "judged"
"""Folder of the worlds that are judged, beside those of the rounds."""


Reading = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,39}$")]
"""A reading's name: a world's folder is made of them."""


class Changes(Model):
    """What would be another bench: ``set`` in all scenarios, ``only`` in one of them."""

    set: list[str] = Field(default_factory=list, description="key=value, as --set of lndrl train")
    only: dict[str, list[str]] = Field(default_factory=dict, description="scenario to key=value")
    dwa: DWAConfig | None = Field(None, description="other parameters of the planner")

    def changes(self, scenario: str) -> list[str]:
        """Of one scenario."""
        return [*self.set, *self.only.get(scenario, [])]


class BenchVariant(Changes):
    """One way the bench could be."""

    why: str = Field(min_length=1, description="one line: what it would tell")

    @property
    def contender(self) -> Contender:
        """DWA as this variant has it."""
        return dwa_of(self)


def dwa_of(*changes: Changes) -> Contender:
    """DWA as the last of ``changes`` that says anything about it has it."""
    told = [each.dwa for each in changes if each.dwa is not None]
    return Contender(METHOD, PlannerSource(METHOD, parameters=told[-1] if told else None), "amcl")


class Factor(Model):
    """Something that the paper leaves open, and the readings of it."""

    why: str = Field(min_length=1, description="one line: what is open, and by what source")
    values: dict[Reading, Changes] = Field(min_length=1, description="readings by name")


class SearchSpec(Model):
    """``search`` of ``configs/calibration.yaml``: combinations of all factors' readings."""

    worlds: Count | None = Field(
        None, description="how many combinations are drawn (by seed) where there are more; or all"
    )
    rounds: list[Count] = Field(
        [40, 160], min_length=1, description="episodes per scenario in each round, ascending"
    )
    judged: Count = Field(500, description="episodes per scenario of those that are left")
    seed: Annotated[int, Field(ge=0)] = Field(2000, description="of the rounds' episodes")
    judge_seed: Annotated[int, Field(ge=0)] = Field(
        2001, description="of the episodes that are judged, in no round"
    )
    planners: dict[str, str] = Field(
        default_factory=dict,
        description="planners that the worlds are judged with beside DWA, by the hash of what they "
        "do, which must not change any more",
    )
    factors: dict[str, Factor] = Field(min_length=1, description="what is open, by name")

    @model_validator(mode="after")
    def _told_apart(self) -> SearchSpec:
        if self.seed == self.judge_seed:
            raise ValueError("judge_seed must differ from seed: what is judged was in no round")
        names = [value for factor in self.factors.values() for value in factor.values]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"readings need names of their own; twice: {', '.join(twice)}")
        if JUDGED in names:
            raise ValueError(f"a reading cannot be called {JUDGED}: its results would lie there")
        if self.rounds != sorted(set(self.rounds)):
            raise ValueError(f"rounds {self.rounds} must ascend: each adds to the one before")
        return self


class CalibrationSpec(Model):
    """``configs/calibration.yaml``."""

    scenarios: list[str] = Field(min_length=1, description="places to test in, by name or file")
    seed: Annotated[int, Field(ge=0)] = Field(0, description="of the episodes, alike for all")
    variants: dict[str, BenchVariant] = Field(min_length=1, description="benches by name")
    search: SearchSpec | None = Field(None, description="readings of all that is open, combined")


@dataclass(frozen=True)
class Target:
    """What one figure of the DWA row should be, and what still counts as met."""

    name: str
    column: str
    value: float
    least: float
    most: float

    def met(self, value: float | None) -> bool:
        """Whether ``value`` is near enough."""
        return value is not None and self.least <= value <= self.most


def targets() -> list[Target]:
    """The paper's row: rates within 0.05 (lost within a factor of two), time and distance within
    a tenth, errors within a factor of 1.5."""
    row = PAPER[METHOD]

    def near(name: str, column: str, by: float) -> Target:
        value = getattr(row, name)
        return Target(name, column, value, value - by, value + by)

    def factor(name: str, column: str, by: float) -> Target:
        value = getattr(row, name)
        return Target(name, column, value, value / by, value * by)

    return [
        near("ar", "AR", 0.05),
        near("cr", "CR", 0.05),
        factor("lr", "LR", 2.0),
        near("sr", "SR", 0.05),
        near("reach_time", "t (s)", 0.1 * row.reach_time),
        near("distance", "d (m)", 0.1 * row.distance),
        factor("position_error", "e_p (m)", 1.5),
        factor("angle_error", "e_α (rad)", 1.5),
        factor("variance_sum", "Σ_v", 1.5),
    ]


def load_calibration(path: Path = CALIBRATION) -> CalibrationSpec:
    """Read the variants; raises UserError naming the file and key."""
    return validate(CalibrationSpec, load_yaml(path), str(path))


def calibration_table(rows: Sequence[tuple[str, Row]], title: str) -> Table:
    """A row per variant: figures, those off target marked, and how many are met."""
    wanted = targets()
    table = Table(title=title, title_justify="left")
    table.add_column("variant")
    table.add_column("episodes", justify="right")
    for target in wanted:
        table.add_column(target.column, justify="right")
    table.add_column("met", justify="right")
    table.add_row("paper", "2,500", *(f"{t.value:.3f}" for t in wanted), "", style="bold")
    bounds = (f"{t.least:.2f}-{t.most:.2f}" for t in wanted)
    table.add_row("  target", "", *bounds, str(len(wanted)), style="dim")
    for name, row in rows:
        figures = row.to_dict()
        cells = [_cell(figures[t.name], t) for t in wanted]
        met = sum(t.met(figures[t.name]) for t in wanted)
        table.add_row(name, f"{len(row.records):,}", *cells, str(met))
    return table


def _cell(value: float | None, target: Target) -> str:
    if value is None:
        return "-"
    words = f"{value:.3f}"
    return words if target.met(value) else f"[yellow]{words} *[/yellow]"
