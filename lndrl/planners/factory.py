"""From what a user types to a planner: one that follows a rule, a run folder or weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.planners.dwa import DWAConfig, DWAPlanner
from lndrl.planners.interface import Planner
from lndrl.planners.simple import RandomPlanner, StraightPlanner

RULES: dict[str, Callable[[RunConfig], Planner]] = {
    RandomPlanner.name: RandomPlanner,
    StraightPlanner.name: StraightPlanner,
    DWAPlanner.name: DWAPlanner,
}
"""Planners that need no weights: two floors and the classical baseline."""


@dataclass(frozen=True)
class PlannerSource:
    """Everything that a planner is built from; picklable, so that workers build the same one.

    ``config`` and ``weights`` are those that were trained together, None for a rule. A run
    that goes on training meanwhile changes neither. ``parameters`` are DWA's where they are not the
    defaults.
    """

    name: str
    config: RunConfig | None = None
    weights: bytes | None = None
    parameters: DWAConfig | None = None

    def build(self, config: RunConfig, greedy: bool = False) -> Planner:
        """The planner for episodes under ``config``.

        ``greedy`` takes the likeliest action instead of sampling; rules ignore it. Raises
        UserError when the weights are for another observation layout than that of ``config``, or
        do not fit its networks.
        """
        if self.parameters is not None:
            return DWAPlanner(config, self.parameters)
        if self.weights is None:
            return RULES[self.name](config)
        from lndrl.planners.policy import PolicyPlanner
        from lndrl.policy import check_layout

        if self.config is not None:
            check_layout(self.name, self.config, config)

        return PolicyPlanner.load(self.name, config, self.weights, greedy)


def planner_source(spec: str) -> PlannerSource:
    """Find ``random``, ``straight``, a run folder, or a weights file.

    Raises UserError when ``spec`` is none of them, or its weights cannot be read.
    """
    if spec in RULES:
        return PlannerSource(spec)
    path = Path(spec)
    if not path.exists():
        raise UserError(
            f"{spec}: no such run folder or weights file; give one, or {' or '.join(RULES)}"
        )
    from lndrl.policy import load_policy  # torch: takes seconds, and rules need none of it

    config, weights = load_policy(path)
    return PlannerSource(spec, config, weights)


def make_planner(spec: str, config: RunConfig | None = None, greedy: bool = False) -> Planner:
    """Planner for ``spec`` under ``config``, by default the one its weights were trained with.

    Raises UserError as ``planner_source`` does, and for a rule without ``config``.
    """
    source = planner_source(spec)
    chosen = config or source.config
    if chosen is None:
        raise UserError(f"planner {spec!r} has no configuration of its own; give one")
    return source.build(chosen, greedy)
