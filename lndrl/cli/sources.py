"""Several planners of one command line: checkpoint, settings, temperature, shield, guard."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from lndrl.cli.notes import say_origins
from lndrl.cli.options import of_run, sampled
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.planners import GuardConfig, PlannerSource, ShieldConfig


def planner_sources(
    planners: Sequence[str],
    settings: dict[str, Any],
    checkpoint: str | None,
    shield: ShieldConfig | None,
    temperature: float | None,
    greedy: bool,
    guard: GuardConfig | None = None,
) -> list[PlannerSource]:
    """What ``planners`` name, each with those options that it takes; says where policies are from.

    Raises UserError for one that is not there, and for an option that goes with none of them.
    """
    from lndrl.planners import is_own_planner, is_rule, takes_settings

    if temperature is not None and all(map(is_rule, planners)):
        raise UserError(
            f"--temperature {temperature:g} goes with a policy, a run folder or weights file; "
            "rules do not sample"
        )
    # Those of a user's own, where there are any, so that rules can be compared with them.
    takers = [each for each in planners if is_own_planner(each)] or [
        each for each in planners if takes_settings(each)
    ]
    if settings and not takers:
        raise UserError(
            "--planner-set goes with a planner of your own, e.g. my_package:Planner, or with a rule"
            " that has parameters, e.g. predictive"
        )
    # Rules beside a policy are there to compare with: they rank nothing and go without.
    shielded = [each for each in planners if not is_rule(each)] or planners
    sources = [
        _source(
            each,
            settings if each in takers else {},
            of_run(each, checkpoint, planners),
            shield if each in shielded else None,
            temperature,
            greedy,
            guard,
        )
        for each in planners
    ]
    say_origins(sources, greedy)
    return sources


def _source(
    planner: str,
    settings: dict[str, Any],
    checkpoint: str | None,
    shield: ShieldConfig | None,
    temperature: float | None,
    greedy: bool,
    guard: GuardConfig | None,
) -> PlannerSource:
    """What ``planner`` names; a temperature is for policies, rules beside them have none."""
    from lndrl.planners import is_rule, planner_source

    source = planner_source(planner, settings, checkpoint=checkpoint, shield=shield, guard=guard)
    return sampled(source, None if is_rule(planner) else temperature, greedy)
