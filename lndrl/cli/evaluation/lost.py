"""``lndrl lost``: why a planner or policy gets lost."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lndrl.cli.again import arguments_given, same_command
from lndrl.cli.completion import complete_scenario
from lndrl.cli.help import say_next
from lndrl.cli.notes import say_notes, say_origins
from lndrl.cli.options import (
    BenchName,
    PlannerSettings,
    TrustModules,
    check_picture,
    names_in,
    part_settings,
    trust,
)
from lndrl.cli.signals import say, telling
from lndrl.errors import UserError
from lndrl.machine.cores import usable_cores

if TYPE_CHECKING:
    from lndrl.config import RunConfig
    from lndrl.evaluation.lost import LostReport, Trace
    from lndrl.planners import PlannerSource


def lost(
    planner: Annotated[
        str,
        typer.Argument(
            metavar="PLANNER",
            help="A rule such as dwa, a run folder, a weights file, module:Class, or a method of"
            " the bench.",
        ),
    ],
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="S,...",
            help="Names or YAML files; default: the bench's; with --own-world the one it was"
            " trained in.",
            show_default=False,
            autocompletion=complete_scenario,
        ),
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, metavar="N", help="Per scenario.")] = 100,
    seed: Annotated[
        int, typer.Option(min=0, metavar="SEED", help="Same seed, same episodes for every planner.")
    ] = 0,
    own_world: Annotated[
        bool,
        typer.Option("--own-world", help="World and filter as it was trained, not the bench's."),
    ] = False,
    bench: BenchName = None,
    workers: Annotated[
        int | None,
        typer.Option(min=0, metavar="W", help="Processes; default: one per core; 0: none."),
    ] = None,
    greedy: Annotated[
        bool, typer.Option("--greedy", help="Take the likeliest action instead of sampling.")
    ] = False,
    planner_set: PlannerSettings = None,
    trust_modules: TrustModules = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Draw where it was lost, and the hazards."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Everything as JSON.")] = False,
) -> None:
    """Say why a planner or policy gets lost.

    How: by a jump of the filter or a drift. When: the ten control steps before. Where: the hazard
    by turning, echoes, people and place.
    """
    if out is not None:
        check_picture(out)
    if own_world and bench is not None:
        raise UserError("--own-world and --bench: one world or the other")
    trust(trust_modules)
    settings = part_settings(planner_set, "--planner-set")
    source, world, configs = _world(
        planner, settings, names_in(scenario), seed, own_world, bench, greedy
    )
    say_notes(note for config in configs for note in config.scenario.map_notes)
    traces = _drive(source, configs, episodes, workers, greedy)
    report = _report(source, world, configs, traces, greedy)
    if out is not None:
        _draw(report, configs, out)
    if json:
        typer.echo(json_format.dumps(report.to_dict(), indent=2))
        return
    from lndrl.cli.tables import print_tables
    from lndrl.evaluation.lost import lost_tables, summary_lines

    print_tables(*lost_tables(report))
    for line in summary_lines(report):
        typer.echo(line)
    place = configs[0].scenario.name
    if out is None:
        say_next("lndrl", *arguments_given(), "--out", "lost.png", then="where, as a picture")
    else:
        say_next("lndrl", "localization", "--scenarios", place, then="the filter alone")


def _world(
    planner: str,
    settings: dict[str, Any],
    scenarios: list[str] | None,
    seed: int,
    own_world: bool,
    spec: str | None,
    greedy: bool,
) -> tuple[PlannerSource, str, list[RunConfig]]:
    """The planner, the world in words, and the configuration of every scenario."""
    from lndrl.config import DEFAULTS, find, load_scenario
    from lndrl.evaluation import settings_for
    from lndrl.evaluation.benchmark import Contender, bench_config, contenders, load_benchmark
    from lndrl.evaluation.lost import check_localization
    from lndrl.planners import is_rule, planner_source

    file = find("bench", spec or DEFAULTS["bench"])
    bench = load_benchmark(file)
    # A rule of the bench may have settings there; what is set here is set of the rule as it is.
    taken = not own_world if is_rule(planner) else not Path(planner).exists()
    if planner in bench.methods and taken and not settings:
        (contender,), _ = contenders(bench, [planner], greedy=greedy, configs=file.parent)
    else:
        source = planner_source(planner, settings or None)
        contender = Contender(source.label, source, "amcl", greedy)
    source = contender.source
    say_origins([source])
    if scenarios == []:
        raise UserError("--scenario: name one or more, with commas between")
    if own_world:
        chosen: list[str | None] = [*scenarios] if scenarios else [None]
        configs = [settings_for(source, name) for name in chosen]
        configs = [config.model_copy(update={"seed": seed}) for config in configs]
        words = "the world that it was trained in" if source.config else "the world of lndrl.yaml"
    else:
        names = scenarios or bench.scenarios
        for name in scenarios or []:
            load_scenario(name)  # says so where there is none of that name
        configs = [bench_config(contender, name, seed, bench.changes_in(name)) for name in names]
        words = f"the world of {file.name}"
    for config in configs:
        check_localization(config)
    called = [config.scenario.name for config in configs]
    for name in called:
        if called.count(name) > 1:
            raise UserError(f"--scenario: two scenarios are called {name}; name each once")
    return source, words, configs


def _drive(
    source: PlannerSource,
    configs: list[RunConfig],
    episodes: int,
    workers: int | None,
    greedy: bool,
) -> list[Trace]:
    from lndrl.evaluation.lost import trace_episodes
    from lndrl.view.progress import progress_bar

    total = episodes * len(configs)
    ended = lost = 0

    def words() -> str:
        return (
            f"{ended} of {total} episodes have ended, {lost} of them lost, and are not kept; "
            f"begin again with: {same_command()}"
        )

    with telling(words), progress_bar(total, f"lost: {source.label}", "episodes") as advance:

        def note(trace: Trace) -> None:
            nonlocal ended, lost
            ended += 1
            lost += trace.is_lost
            advance(1, f"{lost} lost")

        count = usable_cores() if workers is None else workers
        return trace_episodes(source, configs, episodes, count, greedy, note)


def _report(
    source: PlannerSource,
    world: str,
    configs: list[RunConfig],
    traces: list[Trace],
    greedy: bool,
) -> LostReport:
    from lndrl.evaluation.benchmark import bench_hash
    from lndrl.evaluation.lost import Limits, LostReport

    config = configs[0]  # they differ in the scenario alone
    return LostReport(
        planner=f"{source.name} (greedy)" if greedy and source.weights else source.name,
        world=world,
        seed=config.seed,
        scenarios=tuple(config.scenario.name for config in configs),
        limits=Limits(config.task.lost_distance, config.task.lost_angle, config.localization.delay),
        traces=traces,
        hashes={config.scenario.name: bench_hash(config) for config in configs},
    )


def _draw(report: LostReport, configs: list[RunConfig], out: Path) -> None:
    from lndrl.view.pictures.lost import save_lost

    try:
        save_lost(report, [config.scenario for config in configs], out)
    except OSError as error:
        raise UserError(f"--out {out}: cannot be written ({error.strerror})") from None
    say(f"drew {out}")
