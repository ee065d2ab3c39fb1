"""What an evaluation found, and everything needed to repeat it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, cast, get_args

from lndrl.errors import UserError
from lndrl.evaluation.metrics import Metrics, metrics_of
from lndrl.navigation import EpisodeRecord

Actions = Literal["sampled", "greedy", "rule"]


@dataclass(frozen=True)
class EvaluationResult:
    """One planner on one scenario; ``records`` are in the order of the episodes.

    ``actions`` of a policy were sampled or greedy; those of a floor follow its rule.
    ``temperature`` is that of sampled ones. ``own_metrics`` are figures of the user's own by name;
    ``vetoes`` are the control steps in which a shield took another action than the policy's, None
    without one.
    """

    planner: str
    scenario: str
    localization: str
    actions: Actions
    seed: int
    config_hash: str
    program_version: str
    records: tuple[EpisodeRecord, ...]
    own_metrics: Mapping[str, float | None] = field(default_factory=dict)
    temperature: float = 1.0
    vetoes: int | None = None

    @cached_property
    def metrics(self) -> Metrics:
        """The nine metrics over all records."""
        return metrics_of(self.records)

    def to_dict(self) -> dict[str, Any]:
        """Plain types for JSON: provenance, ``metrics``, and ``records`` in episode order."""
        own: dict[str, Any] = {"own_metrics": dict(self.own_metrics)} if self.own_metrics else {}
        if self.vetoes is not None:
            own["vetoes"] = self.vetoes
        warmth = {} if self.temperature == 1.0 else {"temperature": self.temperature}
        return {
            "program_version": self.program_version,
            "planner": self.planner,
            "actions": self.actions,
            **warmth,
            "scenario": self.scenario,
            "localization": self.localization,
            "seed": self.seed,
            "episodes": len(self.records),
            "config_hash": self.config_hash,
            "metrics": self.metrics.to_dict(),
            **own,
            "records": [record.to_dict() for record in self.records],
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any], where: str = "result") -> EvaluationResult:
        """The inverse of ``to_dict``; metrics are computed anew from the records.

        Raises UserError naming ``where`` when a key is missing or of another kind.
        """
        try:
            return cls(
                planner=str(data["planner"]),
                scenario=str(data["scenario"]),
                localization=str(data["localization"]),
                actions=_actions(data["actions"]),
                seed=int(data["seed"]),
                config_hash=str(data["config_hash"]),
                program_version=str(data["program_version"]),
                records=tuple(EpisodeRecord.from_dict(record) for record in data["records"]),
                own_metrics={
                    str(name): None if value is None else float(value)
                    for name, value in data.get("own_metrics", {}).items()
                },
                temperature=float(data.get("temperature", 1.0)),
                vetoes=None if data.get("vetoes") is None else int(data["vetoes"]),
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise UserError(
                f"{where}: not the JSON of lndrl evaluate ({type(error).__name__}: {error})"
            ) from None

    def to_json(self) -> str:
        """``to_dict`` as JSON text."""
        return json.dumps(self.to_dict(), indent=2)


def _actions(value: object) -> Actions:
    if value not in get_args(Actions):
        raise ValueError(f"actions must be one of {', '.join(get_args(Actions))}")
    return cast(Actions, value)


def load_result(path: Path) -> EvaluationResult:
    """Read the JSON of one ``lndrl evaluate --json``; raises UserError naming the file."""
    try:
        data = json.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        raise UserError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: not a readable JSON file ({error})") from None
    return EvaluationResult.from_dict(data, str(path))
