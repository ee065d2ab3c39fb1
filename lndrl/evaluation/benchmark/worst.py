"""The worst episodes of a result, and the planner that drove them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from lndrl.errors import UserError
from lndrl.evaluation.benchmark.replay import Drive, Replay
from lndrl.evaluation.benchmark.run import describe
from lndrl.evaluation.benchmark.spec import (
    Contender,
    Localization,
    bench_config,
    bench_hash,
    choose,
    guard_of,
    policy_of,
)
from lndrl.evaluation.benchmark.store import IDENTITY, Identity, ResultsFolder
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.families import Family, episode_of
from lndrl.planners import PlannerSource, is_rule, planner_source

WORST_FIRST = ("lost", "collided", "timeout", "arrived")
"""Ends of an episode from the worst on: who is lost no longer knows what it runs into."""


@dataclass(frozen=True)
class Recorded:
    """An episode that a results folder holds."""

    scenario: str
    record: EpisodeRecord

    @property
    def episode(self) -> int:
        """The number that its family gives the episode."""
        return episode_of(self.record.world)


def badness(record: EpisodeRecord) -> tuple[int, float, float]:
    """Sorts the worst first: by ``WORST_FIRST``, then mean position error, then time."""
    return WORST_FIRST.index(record.outcome), -record.position_error, -record.time


def worst_episodes(
    folder: ResultsFolder, method: str, scenarios: Sequence[str], count: int
) -> list[Recorded]:
    """The ``count`` worst of ``method`` in all ``scenarios`` together, worst first.

    Episodes alike stay in the order of scenarios and numbers. Raises UserError where there is
    none.
    """
    rows = [
        Recorded(scenario, record)
        for scenario in scenarios
        for _, record in sorted(folder.records(method, scenario).items())
    ]
    if not rows:
        where = ", ".join(scenarios)
        raise UserError(f"{folder.path}: holds no episode of {method} on {where}")
    return sorted(rows, key=lambda row: badness(row.record))[:count]


def contender_tested(folder: ResultsFolder, name: str) -> tuple[Contender, Identity]:
    """Who drove the results of method ``name`` (or of the run folder or file of that name).

    Raises UserError for a method that was not tested, and where its weights are gone or others.
    """
    identity = Identity.read(folder.path / IDENTITY)
    methods = identity.methods
    by_planner = [each for each, what in methods.items() if what.get("planner") == name]
    if name not in methods and by_planner:
        name = by_planner[0]
    choose(list(methods), [name], "method")
    kept = methods[name]
    localization: Localization = "perfect" if kept.get("localization") == "perfect" else "amcl"
    try:
        source = _source_tested(kept.get("planner", name), kept.get("identity", ""))
    except UserError as error:
        raise UserError(f"method {name}: {error}") from None
    contender = Contender(name, source, localization, kept.get("actions") == "greedy")
    if describe(contender) != kept:
        raise UserError(
            f"{folder.path}: method {name} has changed since it was tested there; "
            f"give {source.name} its weights back, or run lndrl benchmark under another --name"
        )
    return contender, identity


def _source_tested(planner: str, identity: str) -> PlannerSource:
    """``planner`` with the settings, or the temperature and shield, that ``identity`` names."""
    identity, guard = guard_of(identity)
    if is_rule(planner):
        return planner_source(planner, _settings(identity), guard=guard)
    temperature, shield = policy_of(identity)
    source = planner_source(planner, shield=shield, guard=guard)
    # Sampled at 1 is not written: whatever the file says by now, that is how it was.
    return source.at_temperature(1.0 if temperature is None else temperature)


def _settings(identity: str) -> dict[str, Any] | None:
    """What was set of a rule or a class of one's own: the JSON that its identity ends with."""
    _, brace, text = identity.partition(" {")
    try:
        return dict(json.loads("{" + text)) if brace else None
    except ValueError:
        return None


def check_scenario(
    folder: ResultsFolder, identity: Identity, contender: Contender, name: str
) -> None:
    """Raises UserError where scenario ``name`` is another one than was tested."""
    config = bench_config(contender, name, identity.seed, identity.changes.get(name, ()))
    if bench_hash(config) != identity.scenarios[name]:
        raise UserError(
            f"{folder.path}: scenario {name} has changed since it was tested there; "
            "run lndrl benchmark under another --name"
        )


def difference(recorded: EpisodeRecord, drive: Drive) -> str:
    """What was recorded, in words, where ``drive`` ended otherwise; "" where it did not."""
    again = drive.record
    if (recorded.outcome, recorded.steps) == (again.outcome, again.steps):
        return ""
    return f"recorded: {recorded.outcome} after {recorded.time:.1f} s"


def drive_again(
    folder: ResultsFolder,
    identity: Identity,
    contender: Contender,
    rows: Sequence[Recorded],
    progress: Callable[[Drive], None],
) -> list[tuple[Drive, str]]:
    """Each of ``rows`` as ``contender`` drives it now, in their order, and the ``difference``.

    Driven scenario by scenario; ``progress`` gets each as it ends. Raises UserError where a
    scenario has changed since it was tested.
    """
    found: dict[tuple[str, int], tuple[Drive, str]] = {}
    for place in dict.fromkeys(row.scenario for row in rows):
        check_scenario(folder, identity, contender, place)
        changes = identity.changes.get(place, ())
        replay = Replay(contender, place, identity.seed, changes, Family(identity.family))
        records = {row.episode: row.record for row in rows if row.scenario == place}
        for drive in replay.drive(list(records), progress):
            found[place, drive.episode] = drive, difference(records[drive.episode], drive)
    return [found[row.scenario, row.episode] for row in rows]
