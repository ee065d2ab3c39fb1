"""Everything that is known of why a planner gets lost, in one object, and as JSON."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, get_args

import numpy as np

from lndrl.evaluation.hazard import Hazard
from lndrl.evaluation.lost.record import AHEAD, Floats, Trace
from lndrl.evaluation.lost.summary import (
    BEFORE,
    CELL,
    FIGURES,
    HEADING_STEPS,
    JUMP_SHARE,
    RISKS,
    TURNED_STEPS,
    Cell,
    Exposure,
    Kind,
    Limit,
    Limits,
    Loss,
    Typical,
    before_losses,
    cells_of,
    exposure_of,
    foretold,
    hazards,
    loss_of,
    typical,
    usual_figures,
)
from lndrl.version import VERSION
from lndrl.wilson import wilson_interval


@dataclass(frozen=True, eq=False)
class LostReport:
    """What ``traces`` of ``planner`` in ``scenarios`` tell, figure by figure when asked for.

    ``world`` says in words under what they were driven, ``hashes`` (scenario to hash) exactly.
    ``traces`` are one or more.
    """

    planner: str
    world: str
    seed: int
    scenarios: tuple[str, ...]
    limits: Limits
    traces: Sequence[Trace]
    hashes: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def losses(self) -> list[Loss]:
        """Every lost episode."""
        return [loss_of(trace, self.limits) for trace in self.traces if trace.is_lost]

    @cached_property
    def exposure(self) -> Exposure:
        """Every control step."""
        return exposure_of(self.traces, self.scenarios, self.limits)

    @cached_property
    def foretold(self) -> float:
        """How many losses errors of heading told of."""
        return foretold(self.traces)

    @property
    def hazard(self) -> Hazard:
        """Over everything."""
        return Hazard(len(self.losses), len(self.exposure.lost))

    def hazards(self, risk: str) -> list[Hazard]:
        """By one of ``RISKS``, bin by bin."""
        return hazards(getattr(self.exposure, risk), self.exposure.lost, RISKS[risk])

    def hazard_in(self, scenario: str) -> Hazard:
        """In one scenario."""
        here = self.exposure.place == self.scenarios.index(scenario)
        return Hazard(int(self.exposure.lost[here].sum()), int(here.sum()))

    def cells(self, scenario: str) -> list[Cell]:
        """By place within one scenario."""
        return cells_of(self.exposure, self.scenarios.index(scenario))

    def episodes_in(self, scenario: str) -> Counter[str]:
        """How many episodes of one scenario ended how."""
        return Counter(t.outcome for t in self.traces if t.scenario == scenario)

    def losses_in(self, scenario: str) -> list[Loss]:
        """The lost episodes of one scenario."""
        return [loss for loss in self.losses if loss.scenario == scenario]

    @cached_property
    def kinds(self) -> dict[Kind, int]:
        """How many jumped, how many drifted."""
        found = Counter(loss.kind for loss in self.losses)
        return {kind: found[kind] for kind in get_args(Kind)}

    @cached_property
    def limits_passed(self) -> dict[Limit, int]:
        """How many passed which limit."""
        found = Counter(loss.limit for loss in self.losses)
        return {limit: found[limit] for limit in get_args(Limit)}

    @cached_property
    def before(self) -> Floats:
        """``FIGURES`` before every loss, (losses, BEFORE + 1, figures)."""
        return before_losses(self.traces, self.limits)

    @property
    def typical_before(self) -> list[list[Typical]]:
        """Over all losses: of every step before, of every figure."""
        return [typical(self.before[:, step]) for step in range(BEFORE + 1)]

    @cached_property
    def usual(self) -> tuple[list[Typical], int]:
        """The same figures in episodes that were not lost, and over how many control steps."""
        return usual_figures(self.traces)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain types; None where a figure does not exist."""
        usual, steps = self.usual
        return {
            "planner": self.planner,
            "world": self.world,
            "program_version": VERSION,
            "seed": self.seed,
            "episodes": len(self.traces),
            "definitions": self._definitions(),
            "hazard": hazard_dict(self.hazard),
            "scenarios": [self._scenario(name) for name in self.scenarios],
            "foretold": self.foretold,
            "kinds": _shares(self.kinds),
            "limits_passed": _shares(self.limits_passed),
            "before": [
                {"step": step - BEFORE, **_figures(each)}
                for step, each in enumerate(self.typical_before)
            ],
            "not_lost": {"steps": steps, **_figures(usual)},
            "hazard_by": {risk: self._bins(risk) for risk in RISKS},
            "losses": [
                {**vars(loss), "before": _series(series)}
                for loss, series in zip(self.losses, self.before, strict=True)
            ],
        }

    def _definitions(self) -> dict[str, float]:
        return {
            "lost_distance": self.limits.distance,
            "lost_angle": self.limits.angle,
            "delay": self.limits.delay,
            "jump_distance": JUMP_SHARE * self.limits.distance,
            "jump_angle": JUMP_SHARE * self.limits.angle,
            "steps_before": BEFORE,
            "turned_steps": TURNED_STEPS,
            "heading_steps": HEADING_STEPS,
            "people_within": AHEAD,
            "cell": CELL,
        }

    def _scenario(self, name: str) -> dict[str, Any]:
        ends = self.episodes_in(name)
        return {
            "scenario": name,
            "hash": self.hashes.get(name),
            "episodes": ends.total(),
            "outcomes": dict(ends),
            "hazard": hazard_dict(self.hazard_in(name)),
            "cells": [
                {"x": cell.x, "y": cell.y, **hazard_dict(cell.hazard)} for cell in self.cells(name)
            ],
        }

    def _bins(self, risk: str) -> list[dict[str, Any]]:
        ends = (None, *RISKS[risk], None)
        return [
            {"from": ends[i], "below": ends[i + 1], **hazard_dict(hazard)}
            for i, hazard in enumerate(self.hazards(risk))
        ]


def hazard_dict(hazard: Hazard) -> dict[str, Any]:
    """As plain types."""
    return {
        "steps": hazard.steps,
        "lost": hazard.count,
        "per_1000": hazard.value if hazard.steps else None,
        "interval": list(hazard.interval) if hazard.steps else None,
    }


def _shares(counts: Mapping[Any, int]) -> dict[str, Any]:
    total = sum(counts.values())
    return {
        name: {
            "count": count,
            "share": count / total if total else None,
            "interval": list(wilson_interval(count, total)) if total else None,
        }
        for name, count in counts.items()
    }


def _figures(each: Sequence[Typical]) -> dict[str, Any]:
    return {
        name: {key: _number(value) for key, value in found._asdict().items()}
        for name, found in zip(FIGURES, each, strict=True)
    }


def _series(figures: Floats) -> dict[str, list[float | None]]:
    """The last steps of one episode, figure by figure."""
    return {
        name: [_number(value) for value in np.atleast_1d(column)]
        for name, column in zip(FIGURES, figures.T, strict=True)
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
