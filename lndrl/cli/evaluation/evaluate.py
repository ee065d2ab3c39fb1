"""``lndrl evaluate``: the paper's nine metrics of a policy or a floor."""

from __future__ import annotations

import json as json_format
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TextIO

import typer

from lndrl.cli.again import same_command
from lndrl.cli.evaluation.driving import arrivals_bar, check_episodes
from lndrl.cli.help import say_next
from lndrl.cli.notes import say_notes
from lndrl.cli.options import (
    BenchName,
    GuardOption,
    GuardSettings,
    PlannerSettings,
    ScenarioName,
    ShieldOption,
    ShieldSettings,
    Temperature,
    TrustModules,
    WhichCheckpoint,
    guard_config,
    part_settings,
    shield_config,
    trust,
)
from lndrl.cli.signals import say
from lndrl.cli.sources import planner_sources
from lndrl.errors import UserError
from lndrl.machine.cores import usable_cores

if TYPE_CHECKING:
    from lndrl.config import RunConfig
    from lndrl.evaluation import EvaluationResult
    from lndrl.evaluation.benchmark import BenchmarkSpec
    from lndrl.navigation import EpisodeRecord
    from lndrl.planners import PlannerSource

Localization = Literal["amcl", "perfect"]


def evaluate(
    planners: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN_OR_WEIGHTS",
            help="Run folder, weights file, 'shipped', 'random', 'straight', 'dwa', 'predictive',"
            " 'careful', 'careful+map' or module:Class; several are compared.",
        ),
    ],
    scenario: ScenarioName = None,
    episodes: Annotated[int, typer.Option(metavar="N", help="Episodes per planner.")] = 200,
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
    localization: Annotated[
        Localization | None, typer.Option(help="Default: as trained; perfect hands out the truth.")
    ] = None,
    checkpoint: WhichCheckpoint = None,
    bench: Annotated[
        bool,
        typer.Option(
            "--bench",
            help="In the bench's world: its filter, delay and limits; still other episodes than"
            " those of lndrl benchmark.",
        ),
    ] = False,
    spec: BenchName = None,
    metric: Annotated[
        list[str] | None,
        typer.Option(
            metavar="M",
            help="A metric of your own beside the nine, module:Class; can be repeated.",
            show_default=False,
        ),
    ] = None,
    planner_set: PlannerSettings = None,
    shield: ShieldOption = False,
    shield_set: ShieldSettings = None,
    guard: GuardOption = False,
    guard_set: GuardSettings = None,
    trust_modules: TrustModules = None,
    json: Annotated[bool, typer.Option("--json", help="Metrics and episodes as JSON.")] = False,
) -> None:
    """Measure a policy with the paper's nine metrics.

    Its episodes are there to choose by; those that lndrl benchmark judges by are others.
    """
    check_episodes(episodes, seed, workers)
    if spec is not None and not bench:
        raise UserError(f"--spec {spec} names a bench; it goes with --bench")
    trust(trust_modules)
    settings = part_settings(planner_set, "--planner-set")
    shielded, guarded = shield_config(shield, shield_set), guard_config(guard, guard_set)
    from lndrl.evaluation import add_metrics, own_metrics

    sources = planner_sources(
        planners, settings, checkpoint, shielded, temperature, greedy, guarded
    )
    own = own_metrics(metric or [])
    count = usable_cores() if workers is None else workers
    world = _World(scenario, localization, _bench(spec) if bench else None)
    works = [_Evaluation(source, world, episodes, seed, greedy) for source in sources]
    say_notes(note for work in works for note in work.config.scenario.map_notes)
    results: list[EvaluationResult] = []
    for work in works:
        try:
            results.append(add_metrics(work.run(count), own))
        except KeyboardInterrupt:
            _show_unfinished(work, results, sys.stderr if json else sys.stdout)
            raise
    if json:
        dictionaries = [result.to_dict() for result in results]
        content = dictionaries[0] if len(results) == 1 else {"results": dictionaries}
        typer.echo(json_format.dumps(content, indent=2))
        return
    from lndrl.cli.tables import print_tables
    from lndrl.evaluation import comparison_table, result_table

    print_tables(*(result_table(result) for result in results))
    if len(results) > 1:
        print_tables(comparison_table(results))
    _say_what_next(planners[0], scenario, results)


def _bench(spec: str | None) -> BenchmarkSpec:
    from lndrl.config import DEFAULTS, find
    from lndrl.evaluation.benchmark import load_benchmark

    return load_benchmark(find("bench", spec or DEFAULTS["bench"]))


@dataclass(frozen=True)
class _World:
    """What was asked for of the world that planners are tested in."""

    scenario: str | None
    localization: Localization | None
    bench: BenchmarkSpec | None

    def config_of(self, source: PlannerSource) -> RunConfig:
        """What ``source`` is tested under: as it was trained, or as the bench has it."""
        from lndrl.config import load_scenario
        from lndrl.evaluation import settings_for
        from lndrl.evaluation.benchmark import Contender, bench_config

        if self.bench is None:
            return settings_for(source, self.scenario, self.localization)
        if self.scenario is not None:
            load_scenario(self.scenario)  # says so where there is none of that name
        known = self.bench.scenarios
        trained = source.config.scenario.name if source.config is not None else ""
        place = self.scenario or (trained if trained in known else known[0])
        contender = Contender(source.label, source, self.localization or "amcl")
        changes = self.bench.changes_in(place)
        return bench_config(contender, place, self.bench.seed, changes)


class _Evaluation:
    """One planner's episodes, of which those that have ended are known at any time."""

    def __init__(
        self,
        source: PlannerSource,
        world: _World,
        episodes: int,
        seed: int,
        greedy: bool,
    ) -> None:
        self.source = source
        config = world.config_of(source)
        self.config = config.model_copy(update={"seed": seed})
        self.episodes, self.greedy = episodes, greedy
        self.title = f"{Path(source.title).name} on {config.scenario.name}"
        self.records: list[EpisodeRecord] = []

    def run(self, workers: int) -> EvaluationResult:
        """All episodes, with a bar that says how far they are."""
        from lndrl.evaluation import evaluate as run_evaluation

        with arrivals_bar(self.episodes, self.title) as advance:

            def note(record: EpisodeRecord) -> None:
                self.records.append(record)
                advance(record)

            seed, greedy = self.config.seed, self.greedy
            return run_evaluation(
                self.source, self.config, self.episodes, seed, workers, greedy, note
            )


def _say_what_next(planner: str, scenario: str | None, results: list[EvaluationResult]) -> None:
    """Why it gets lost, where one does; else what an episode of the first looks like."""
    named = (planner, "--scenario", scenario) if scenario else (planner,)
    if len(results) == 1 and any(record.outcome == "lost" for record in results[0].records):
        say_next("lndrl", "lost", *named, then="why it gets lost")
    else:
        say_next("lndrl", "play", *named, "--out", "walk.gif", then="an episode as a film")


def _show_unfinished(work: _Evaluation, done: list[EvaluationResult], file: TextIO) -> None:
    """What there is when it is interrupted; never on a stdout where JSON is expected."""
    from lndrl.cli.tables import print_tables
    from lndrl.evaluation import result_of, result_table

    with suppress(OSError):
        print_tables(*(result_table(result) for result in done), file=file)
        if work.records:
            so_far = result_of(work.source, work.config, work.greedy, work.records)
            print_tables(result_table(so_far, work.episodes), file=file)
    say(
        f"stopped: {work.title}, {len(work.records)} of {work.episodes} episodes have ended and "
        f"are not kept; begin again with: {same_command()}"
    )
