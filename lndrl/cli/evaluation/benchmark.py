"""``lndrl benchmark``: the paper's table, from episodes that every method faces alike."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from lndrl.cli.again import same_command
from lndrl.cli.options import BenchName, TrustModules, names_in, trust
from lndrl.cli.signals import telling
from lndrl.errors import UserError
from lndrl.machine.cores import usable_cores

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark import Cell, Plan, ResultsFolder
    from lndrl.navigation import EpisodeRecord

RESULTS = Path("results")


def benchmark(
    methods: Annotated[
        str | None,
        typer.Option(metavar="M,...", help="Rows of the table; default: all that have weights."),
    ] = None,
    scenarios: Annotated[
        str | None, typer.Option(metavar="S,...", help="Default: the bench's five.")
    ] = None,
    episodes: Annotated[
        int | None, typer.Option(metavar="N", help="Per method and scenario. [default: 500]")
    ] = None,
    name: Annotated[
        str, typer.Option(metavar="NAME", help="Folder results/NAME; what is there is kept.")
    ] = "benchmark",
    table: Annotated[
        bool, typer.Option("--table", help="Only show what is there; run nothing.")
    ] = False,
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
    if episodes is not None and episodes < 1:
        raise UserError(f"--episodes {episodes}: must be 1 or more")
    if workers is not None and workers < 0:
        raise UserError(f"--workers {workers}: must be 0 (in this process) or more")
    trust(trust_modules)
    from lndrl.config import DEFAULTS, find
    from lndrl.evaluation.benchmark import (
        IDENTITY,
        Identity,
        Plan,
        ResultsFolder,
        check_frozen,
        choose,
        contenders,
        load_benchmark,
    )

    file = find("bench", spec or DEFAULTS["bench"])
    bench = load_benchmark(file)
    folder = ResultsFolder(RESULTS / name)
    places = choose(bench.scenarios, names_in(scenarios), "scenario")
    if table:
        wanted = names_in(methods)
        chosen = None if wanted is None else choose(list(bench.methods), wanted, "method")
        check_frozen(bench, Identity.read(folder.path / IDENTITY).scenarios)
        _show(folder, chosen, None if scenarios is None else places, episodes, json)
        return
    found, missing = contenders(bench, names_in(methods), localization, greedy, file.parent)
    if missing:
        typer.echo(f"without weights, left out: {', '.join(missing)}", err=True)
    count = episodes or 500
    plan = Plan(folder, found, places, count, bench.seed, bench.changes)
    check_frozen(bench, plan.identity.scenarios)
    with folder.locked():
        _run(plan, usable_cores() if workers is None else workers)
        _summarize(plan)
    _show(folder, [contender.name for contender in found], places, count, json)


def _run(plan: Plan, workers: int) -> None:
    from lndrl.view.progress import progress_bar

    left = plan.left()
    ended = 0

    def words() -> str:
        return (
            f"{ended} of {left} missing episodes have ended and are kept in {plan.folder.path}; "
            f"go on with: {same_command()}"
        )

    with telling(words), progress_bar(left, "benchmark", "episodes") as advance:

        def note(cell: Cell, record: EpisodeRecord) -> None:
            nonlocal ended
            ended += 1
            advance(1, f"{cell.contender.name} on {cell.scenario}: {record.outcome}")

        plan.run(workers, note)


def _summarize(plan: Plan) -> None:
    from lndrl.evaluation.benchmark import IDENTITY, Identity, rows_of, summary_of

    identity = Identity.read(plan.folder.path / IDENTITY)
    rows = rows_of(plan.folder, episodes=plan.episodes)
    plan.folder.write_summary(summary_of(identity, rows, plan.episodes))


def _show(
    folder: ResultsFolder,
    methods: list[str] | None,
    scenarios: list[str] | None,
    episodes: int | None,
    json: bool,
) -> None:
    from lndrl.evaluation.benchmark import IDENTITY, Identity, benchmark_table, rows_of

    rows = rows_of(folder, methods, scenarios, episodes)
    if json:
        typer.echo(json_format.dumps([row.to_dict() for row in rows], indent=2))
        return
    from lndrl.cli.tables import print_tables

    identity = Identity.read(folder.path / IDENTITY)
    tested = scenarios or list(identity.scenarios)
    print_tables(benchmark_table(rows, f"{', '.join(tested)}; seed {identity.seed}"))
