"""``lndrl returns``: what planners earn by a training's reward, at one discount and another."""

from __future__ import annotations

import json as json_format
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.again import arguments_given, same_command
from lndrl.cli.completion import complete_configuration, complete_scenario
from lndrl.cli.evaluation.driving import arrivals_bar, check_episodes
from lndrl.cli.help import say_next
from lndrl.cli.notes import say_notes
from lndrl.cli.options import (
    PlannerSettings,
    Settings,
    Temperature,
    TrustModules,
    WhichCheckpoint,
    part_settings,
    trust,
)
from lndrl.cli.signals import telling
from lndrl.cli.sources import planner_sources
from lndrl.errors import UserError
from lndrl.machine.cores import usable_cores

if TYPE_CHECKING:
    from lndrl.config import RunConfig
    from lndrl.evaluation.returns import PlannerReturns
    from lndrl.navigation import EpisodeRecord
    from lndrl.planners import PlannerSource

DISCOUNTS = (0.95, 0.98, 0.99, 0.995, 1.0)


def returns(
    planners: Annotated[
        list[str],
        typer.Argument(
            metavar="PLANNER_OR_RUN",
            help="A rule such as predictive, careful or dwa, a run folder, a weights file,"
            " 'shipped' or module:Class; others are compared with the first.",
        ),
    ],
    discount: Annotated[
        list[float] | None,
        typer.Option(
            metavar="D",
            help="Above 0, at most 1; can be repeated; default: 0.95, 0.98, 0.99, 0.995 and 1.",
            show_default=False,
        ),
    ] = None,
    episodes: Annotated[int, typer.Option(metavar="N", help="Episodes per planner.")] = 400,
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="S",
            help="Name or YAML file; default: the configuration's.",
            autocompletion=complete_scenario,
        ),
    ] = None,
    config: Annotated[
        str,
        typer.Option(
            metavar="CONFIG",
            help="Whose reward and world it is, for all planners: a configuration's name, YAML file"
            " or run folder.",
            autocompletion=complete_configuration,
        ),
    ] = "lndrl",
    settings: Settings = None,
    seed: Annotated[
        int, typer.Option(metavar="SEED", help="Same seed, same episodes for every planner.")
    ] = 0,
    workers: Annotated[
        int | None,
        typer.Option(metavar="W", help="Processes; default: one per core; 0: none but this."),
    ] = None,
    greedy: Annotated[
        bool, typer.Option("--greedy", help="Take the likeliest action instead of sampling.")
    ] = False,
    temperature: Temperature = None,
    checkpoint: WhichCheckpoint = None,
    planner_set: PlannerSettings = None,
    trust_modules: TrustModules = None,
    parts: Annotated[
        bool, typer.Option("--parts", help="The reward's parts at each discount, not the largest.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Everything and episodes as JSON.")] = False,
) -> None:
    """Say at which discount a reward pays for which planner's way of driving.

    Drives the validation episodes of lndrl evaluate and adds up what the learner
    would be paid: scaled and limited as configured, own reward terms included.
    A timeout is an end here; a learner adds the value of what would follow.

    A larger reward wants a larger ppo.reward_limit, which else cuts it.
    """
    check_episodes(episodes, seed, workers)
    discounts = _discounts(discount)
    trust(trust_modules)
    base = _base(config, settings or [], scenario, seed)
    sources = planner_sources(
        planners, part_settings(planner_set, "--planner-set"), checkpoint, None, temperature, greedy
    )
    say_notes(base.scenario.map_notes)
    from lndrl.evaluation.returns import ReturnsReport, returns_tables

    count = usable_cores() if workers is None else workers
    found = _drive(sources, base, episodes, discounts, count, greedy)
    words = " ".join([Path(config).name, *(settings or [])])
    report = ReturnsReport(words, tuple(found))
    if json:
        typer.echo(json_format.dumps(report.to_dict(), indent=2))
        return
    from lndrl.cli.tables import print_tables

    print_tables(*returns_tables(report, parts))
    if not parts:
        say_next("lndrl", *arguments_given(), "--parts", then="what each part of the reward pays")


def _discounts(given: list[float] | None) -> tuple[float, ...]:
    """Those that were asked for, each once."""
    for discount in given or ():
        if not 0.0 < discount <= 1.0:  # NaN fails every comparison
            raise UserError(
                f"--discount {discount:g}: must be above 0 and at most 1; 1 counts every step alike"
            )
    return tuple(dict.fromkeys(given or DISCOUNTS))


def _base(name: str, settings: list[str], scenario: str | None, seed: int) -> RunConfig:
    """Whose reward and world it is."""
    from lndrl.config import load_config, load_scenario

    if scenario is not None and any(each.startswith("scenario") for each in settings):
        raise UserError(f"--scenario {scenario} and --set scenario: one or the other")
    changes: dict[str, object] = {"seed": seed}
    if scenario is not None:
        changes["scenario"] = load_scenario(scenario)
    return load_config(name, settings).model_copy(update=changes)


def _drive(
    sources: Sequence[PlannerSource],
    base: RunConfig,
    episodes: int,
    discounts: tuple[float, ...],
    workers: int,
    greedy: bool,
) -> list[PlannerReturns]:
    """All planners, one after the other, each with a bar."""
    from lndrl.evaluation.returns import drive_returns, paid_as

    found: list[PlannerReturns] = []
    ended = 0

    def words() -> str:
        return (
            f"{ended} of {episodes * len(sources)} episodes have ended and are not kept; "
            f"begin again with: {same_command()}"
        )

    with telling(words):
        for source in sources:
            title = f"{Path(source.title).name} on {base.scenario.name}"
            with arrivals_bar(episodes, title) as advance:

                def note(record: EpisodeRecord) -> None:
                    nonlocal ended
                    ended += 1
                    advance(record)

                config = paid_as(base, source)
                found.append(
                    drive_returns(source, config, episodes, discounts, workers, greedy, note)
                )
    return found
