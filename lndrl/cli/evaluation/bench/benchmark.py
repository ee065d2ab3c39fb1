"""``lndrl benchmark``: the paper's table, from episodes that every method faces alike."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from lndrl.cli.evaluation.driving import drive_plans
from lndrl.cli.help import say_next
from lndrl.cli.notes import say_origins
from lndrl.cli.options import BenchName, TrustModules, names_in, trust
from lndrl.errors import UserError
from lndrl.machine.cores import usable_cores
from lndrl.wording import counted

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark import BenchmarkSpec, Plan, ResultsFolder

RESULTS = Path("results")
NAME = "benchmark"


def benchmark(
    methods: Annotated[
        str | None,
        typer.Option(metavar="M,...", help="Rows of the table; default: all that have weights."),
    ] = None,
    scenarios: Annotated[
        str | None, typer.Option(metavar="S,...", help="Default: the bench's five.")
    ] = None,
    episodes: Annotated[
        int | None, typer.Option(metavar="N", help="Per method and scenario; default: 500.")
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Folder results/NAME, else benchmark; what is there is kept.",
            show_default=False,
        ),
    ] = None,
    table: Annotated[
        bool,
        typer.Option(
            "--table",
            help="Only show what is there, or what comes with the program; run nothing.",
        ),
    ] = False,
    source: Annotated[
        Path | None,
        typer.Option("--from", metavar="FOLDER", help="Show the results in FOLDER; run nothing."),
    ] = None,
    pack: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Write what is there to FOLDER, compressed, and how the policies were trained.",
        ),
    ] = None,
    localization: Annotated[
        Literal["amcl", "perfect"] | None, typer.Option(help="For all methods; perfect: the truth.")
    ] = None,
    greedy: Annotated[
        bool, typer.Option("--greedy", help="Take the likeliest action instead of sampling.")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(metavar="W", help="Processes; default: one per core; 0: none but this."),
    ] = None,
    spec: BenchName = None,
    trust_modules: TrustModules = None,
    json: Annotated[bool, typer.Option("--json", help="The table as JSON.")] = False,
) -> None:
    """Test methods in scenarios and show the paper's table beside ours.

    Every method faces the same episodes. Stopped with Ctrl-C, the same command goes on.
    """
    _check(episodes, workers, name, source)
    trust(trust_modules)
    from lndrl.config import DEFAULTS, find
    from lndrl.evaluation.benchmark import (
        EPISODES,
        Plan,
        ResultsFolder,
        check_frozen,
        choose,
        contenders,
        load_benchmark,
    )

    file = find("bench", spec or DEFAULTS["bench"])
    bench = load_benchmark(file)
    places = choose(bench.scenarios, names_in(scenarios), "scenario")
    chosen = names_in(methods)
    if chosen is not None:
        chosen = choose(list(bench.methods), chosen, "method")
    count = episodes or EPISODES
    folder = ResultsFolder(source or RESULTS / (name or NAME))
    if table or source or pack:
        shown = places if scenarios is not None else None
        if pack is not None:
            _pack(bench, folder, pack, count, chosen, shown)
            return
        if name is None and source is None:
            folder = results_there(bench, file, folder)
        _show(bench, folder, chosen, shown, episodes, json)
        return
    found, missing = contenders(bench, chosen, localization, greedy, file.parent)
    if missing:
        typer.echo(f"without weights, left out: {', '.join(missing)}", err=True)
    say_origins([contender.source for contender in found], greedy)
    plan = Plan(folder, found, places, count, bench.seed, bench.changes, version=bench.version)
    check_frozen(bench, plan.identity.scenarios)
    with folder.locked():
        cores = usable_cores() if workers is None else workers
        drive_plans([plan], "benchmark", plan.folder.path, cores)
        _summarize(plan)
    _show(bench, folder, [contender.name for contender in found], places, count, json)


def _check(
    episodes: int | None, workers: int | None, name: str | None, source: Path | None
) -> None:
    if episodes is not None and episodes < 1:
        raise UserError(f"--episodes {episodes}: must be 1 or more")
    if workers is not None and workers < 0:
        raise UserError(f"--workers {workers}: must be 0 (in this process) or more")
    if name is not None and source is not None:
        raise UserError(f"--from {source} and --name {name} name two folders; give one")


def results_there(bench: BenchmarkSpec, file: Path, own: ResultsFolder) -> ResultsFolder:
    """``own`` results, or where there are none those that come with the program."""
    from lndrl.evaluation.benchmark import IDENTITY, shipped_results

    shipped = shipped_results(bench, file)
    if shipped is None or (own.path / IDENTITY).exists():
        return own
    typer.echo(f"{own.path}: holds no results yet; shown are those in {shipped.path}", err=True)
    return shipped


def _pack(
    bench: BenchmarkSpec,
    folder: ResultsFolder,
    target: Path,
    episodes: int,
    methods: list[str] | None,
    scenarios: list[str] | None,
) -> None:
    from lndrl.evaluation.benchmark import check_bench, pack, pack_trainings

    check_bench(bench, folder)
    files = pack(folder, target, episodes, methods, scenarios)
    told = f"{len(files)} files of {episodes:,} episodes each"
    trained, unknown = pack_trainings(folder, target, methods)
    if trained:
        told += f", how {counted(len(trained), 'policy', 'policies')} had been trained"
    size = sum(file.stat().st_size for file in files + trained)
    typer.echo(f"{target}: {told}, {size / 1e6:.2f} MB")
    if unknown:
        typer.echo(
            f"how these were trained is not packed: {', '.join(unknown)}; no run folder here holds "
            "the version that was tested",
            err=True,
        )


def _summarize(plan: Plan) -> None:
    from lndrl.evaluation.benchmark import IDENTITY, Identity, rows_of, summary_of

    identity = Identity.read(plan.folder.path / IDENTITY)
    rows = rows_of(plan.folder, episodes=plan.episodes)
    plan.folder.write_summary(summary_of(identity, rows, plan.episodes))


def _show(
    bench: BenchmarkSpec,
    folder: ResultsFolder,
    methods: list[str] | None,
    scenarios: list[str] | None,
    episodes: int | None,
    json: bool,
) -> None:
    from lndrl.evaluation.benchmark import (
        IDENTITY,
        Identity,
        benchmark_table,
        check_bench,
        rows_of,
    )

    check_bench(bench, folder)
    rows = rows_of(folder, methods, scenarios, episodes)
    if json:
        typer.echo(json_format.dumps([row.to_dict() for row in rows], indent=2))
        return
    from lndrl.cli.tables import print_tables

    identity = Identity.read(folder.path / IDENTITY)
    tested = ", ".join(scenarios or list(identity.scenarios))
    title = f"{tested}; seed {identity.seed}; version {identity.bench_version} of the bench"
    print_tables(benchmark_table(rows, title))
    say_next("lndrl", "results", "--from", folder.path, then="beside the paper, compared in pairs")
