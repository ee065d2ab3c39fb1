"""The localization report: every setting on the same drives, spread over the cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

from lndrl.config import LocalizationConfig, TaskConfig, WorldConfig
from lndrl.errors import UserError
from lndrl.evaluation.localization.drives import Drive, record_drive
from lndrl.evaluation.localization.figures import Cell, Outcome, cell_of
from lndrl.evaluation.localization.replay import Replayer
from lndrl.evaluation.localization.settings import with_pedestrians
from lndrl.evaluation.localization.tour import RouteMap
from lndrl.evaluation.pool import Work, run_tasks
from lndrl.localization import LikelihoodMap
from lndrl.scenario import Scenario
from lndrl.version import VERSION
from lndrl.world import Place

LEAST_UPDATES = 60


class Task(NamedTuple):
    """One recorded drive: which scenario, with how many pedestrians, from which seed."""

    scenario: int
    pedestrians: int
    seed: int


@dataclass(frozen=True)
class DriveFacts:
    """What a drive was like, whatever filter replayed it; lengths in m."""

    scenario: str
    pedestrians: int
    seed: int
    length: float
    goals_reached: int
    wall_hits: int
    pedestrian_hits: int


@dataclass(frozen=True)
class Plan:
    """What is measured; settings by label."""

    scenarios: tuple[Scenario, ...]
    pedestrians: tuple[int, ...]
    settings: Mapping[str, LocalizationConfig]
    seeds: int
    updates: int
    world: WorldConfig = field(default_factory=WorldConfig)
    task: TaskConfig = field(default_factory=TaskConfig)

    def tasks(self) -> list[Task]:
        """All drives, those of one scenario together."""
        return [
            Task(scenario, people, seed)
            for scenario in range(len(self.scenarios))
            for people in self.pedestrians
            for seed in range(self.seeds)
        ]

    def check(self) -> None:
        """Raise UserError for what cannot be measured, before any work."""
        if self.seeds < 1:
            raise UserError(f"{self.seeds} seeds give no figures; give 1 or more")
        if self.updates < LEAST_UPDATES:
            raise UserError(
                f"{self.updates} updates leave no time to recover; give {LEAST_UPDATES} or more"
            )
        _check_names("scenario", [scenario.name for scenario in self.scenarios])
        _check_names("pedestrian count", self.pedestrians)
        _check_names("setting", tuple(self.settings))
        last = self.world.ticks_per_step
        for label, config in self.settings.items():
            if config.update_ticks is not None and config.update_ticks[-1] != last:
                raise UserError(
                    f"setting {label}: update_ticks {config.update_ticks} must end with {last}, "
                    "the last tick of a control step of the drives"
                )
        for scenario in self.scenarios:
            for people in self.pedestrians:
                with_pedestrians(scenario, people)


@dataclass(frozen=True)
class Report:
    """What was found; ``outcomes`` and ``drives`` in the order of the plan's tasks."""

    plan: Plan
    drives: tuple[DriveFacts, ...]
    outcomes: tuple[Outcome, ...]

    def cells(self) -> list[Cell]:
        """Means over seeds by scenario, pedestrians and setting, in the plan's order."""
        return [
            cell_of(self._chosen(scenario.name, people, label))
            for scenario in self.plan.scenarios
            for people in self.plan.pedestrians
            for label in self.plan.settings
        ]

    def summary(self) -> list[Cell]:
        """Means over all scenarios by pedestrians and setting."""
        return [
            cell_of(self._chosen(None, people, label), scenario="all")
            for people in self.plan.pedestrians
            for label in self.plan.settings
        ]

    def _chosen(self, scenario: str | None, people: int, label: str) -> list[Outcome]:
        return [
            o
            for o in self.outcomes
            if o.setting == label
            and o.pedestrians == people
            and (scenario is None or o.scenario == scenario)
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain types for JSON; without the error series."""
        plan = self.plan
        return {
            "program_version": VERSION,
            "scenarios": [scenario.name for scenario in plan.scenarios],
            "pedestrians": list(plan.pedestrians),
            "seeds": plan.seeds,
            "updates": plan.updates,
            "settings": {k: v.model_dump(mode="json") for k, v in plan.settings.items()},
            "summary": [cell.to_dict() for cell in self.summary()],
            "cells": [cell.to_dict() for cell in self.cells()],
            "drives": [asdict(facts) for facts in self.drives],
            "outcomes": [outcome.to_dict() for outcome in self.outcomes],
        }


def measure_localization(
    plan: Plan, workers: int = 0, progress: Callable[[Outcome], None] | None = None
) -> Report:
    """Record every drive of ``plan`` once and replay it under every setting.

    ``workers`` processes share the drives, 0 keeps them in this one; all but the times are the
    same. ``progress`` gets each outcome when it is ready. Ctrl-C leaves no process.

    Raises UserError for an impossible plan or scenario, or when a worker dies.
    """
    plan.check()
    tasks = plan.tasks()
    facts: dict[Task, DriveFacts] = {}
    outcomes: dict[tuple[Task, str], Outcome] = {}
    results = run_tasks(_make_work, (plan,), tasks, min(workers, len(tasks)))
    with closing(results):
        for task, result in results:
            if isinstance(result, DriveFacts):
                facts[task] = result
                continue
            outcomes[task, result.setting] = result
            if progress is not None:
                progress(result)
    return Report(
        plan,
        tuple(facts[task] for task in tasks),
        tuple(outcomes[task, label] for task in tasks for label in plan.settings),
    )


def _check_names(kind: str, names: Sequence[Any]) -> None:
    if not names:
        raise UserError(f"no {kind} is named; give one or more")
    twice = [name for name in names if list(names).count(name) > 1]
    if twice:
        raise UserError(f"{kind} {twice[0]} is named twice; give each one name of its own")


def _make_work(plan: Plan) -> Work:
    return _Worker(plan)


class _Worker:
    """Records drives and replays them; keeps what belongs to the scenario at hand."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._scenario = -1

    def __call__(self, task: Task) -> Iterator[tuple[Task, DriveFacts | Outcome]]:
        """Yield the drive's facts, then one outcome per setting."""
        plan = self.plan
        if task.scenario != self._scenario:
            self._prepare(task.scenario)
        name = plan.scenarios[task.scenario].name
        place, routes = self._places[task.pedestrians]
        drive = record_drive(place, routes, plan.world, task.seed, plan.updates)
        yield task, _facts(drive, name, task)
        for label, replayer in self._replayers.items():
            yield task, replayer.outcome(drive, task.seed, label, name, task.pedestrians)

    def _prepare(self, number: int) -> None:
        plan = self.plan
        self._scenario = number
        self._places = {}
        for people in plan.pedestrians:
            scenario = with_pedestrians(plan.scenarios[number], people)
            place = Place.build(scenario, plan.world.robot_radius)
            self._places[people] = place, RouteMap.build(place)
        self._replayers = {
            label: Replayer(
                LikelihoodMap.build(place.grid, config, plan.world.laser),
                config,
                plan.world.laser,
                plan.task,
            )
            for label, config in plan.settings.items()
        }


def _facts(drive: Drive, scenario: str, task: Task) -> DriveFacts:
    return DriveFacts(
        scenario=scenario,
        pedestrians=task.pedestrians,
        seed=task.seed,
        length=drive.length,
        goals_reached=drive.goals_reached,
        wall_hits=drive.hits["wall"],
        pedestrian_hits=drive.hits["pedestrian"],
    )
