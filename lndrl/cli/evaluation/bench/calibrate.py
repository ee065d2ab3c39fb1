"""``lndrl calibrate``: variants of the bench against the paper's DWA row."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.again import arguments_given
from lndrl.cli.evaluation.bench.benchmark import RESULTS
from lndrl.cli.evaluation.driving import drive_plans
from lndrl.cli.help import say_next
from lndrl.cli.options import TrustModules, trust
from lndrl.errors import UserError
from lndrl.machine.cores import usable_cores

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark import CalibrationSpec, Row


def calibrate(
    file: Annotated[
        str | None,
        typer.Argument(
            metavar="[FILE]",
            help="YAML file of variants; default: calibration.",
            show_default=False,
        ),
    ] = None,
    variants: Annotated[
        str | None, typer.Option(metavar="V,...", help="Default: all of the file.")
    ] = None,
    episodes: Annotated[
        int, typer.Option(min=1, metavar="N", help="Per variant and scenario.")
    ] = 40,
    name: Annotated[
        str, typer.Option(metavar="NAME", help="Folder results/NAME; what is there is kept.")
    ] = "calibration",
    table: Annotated[
        bool, typer.Option("--table", help="Only show what is there; run nothing.")
    ] = False,
    by_scenario: Annotated[
        bool, typer.Option("--by-scenario", help="A row for every scenario, too.")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(min=0, metavar="W", help="Processes; default: one per core; 0: none."),
    ] = None,
    search: Annotated[
        bool,
        typer.Option(
            "--search",
            help="Combine all readings of the file's search, drop what is excluded, judge the rest"
            " (hours of two cores).",
        ),
    ] = False,
    trust_modules: TrustModules = None,
    json: Annotated[bool, typer.Option("--json", help="The rows as JSON.")] = False,
) -> None:
    """Show how near variants of the bench bring DWA to the paper's figures for it.

    Stopped with Ctrl-C, the same command goes on.
    """
    trust(trust_modules)
    from lndrl.config import DEFAULTS, find
    from lndrl.evaluation.benchmark import ResultsFolder, choose, load_calibration

    path = find("calibration", file or DEFAULTS["calibration"])
    spec = load_calibration(path)
    if search:
        if spec.search is None:
            raise UserError(f"{path}: search is missing; name its factors there")
        if variants is not None or by_scenario:
            wrong = "--by-scenario" if variants is None else f"--variants {variants}"
            raise UserError(f"{wrong} goes with the file's variants, not with --search")
        from lndrl.cli.evaluation.bench.calibrate_search import search_worlds

        count = usable_cores() if workers is None else workers
        search_worlds(spec, RESULTS / name / "search", table, count, json)
        return
    asked = None if variants is None else [v.strip() for v in variants.split(",") if v.strip()]
    chosen = choose(list(spec.variants), asked, "variant")
    if not table:
        count = usable_cores() if workers is None else workers
        with ResultsFolder(RESULTS / name).locked():
            _run(spec, chosen, RESULTS / name, episodes, count)
    rows = _rows(spec, chosen, RESULTS / name, episodes, by_scenario)
    if not rows:
        raise UserError(f"{RESULTS / name}: holds no finished episode of what was asked for")
    if json:
        content = [{"variant": label, **row.to_dict()} for label, row in rows]
        typer.echo(json_format.dumps(content, indent=2))
        return
    from lndrl.cli.tables import print_tables
    from lndrl.evaluation.benchmark import calibration_table

    print_tables(calibration_table(rows, f"{', '.join(spec.scenarios)}; seed {spec.seed}"))
    typer.echo("* off target")
    if not by_scenario:
        say_next("lndrl", *arguments_given(), "--by-scenario", then="place by place")


def _run(spec: CalibrationSpec, names: list[str], place: Path, episodes: int, workers: int) -> None:
    from lndrl.evaluation.benchmark import Plan, ResultsFolder, load_benchmark
    from lndrl.navigation.families import Family

    bench = load_benchmark()
    plans = [
        Plan(
            ResultsFolder(place / name),
            [spec.variants[name].contender],
            spec.scenarios,
            episodes,
            spec.seed,
            {s: [*bench.changes_in(s), *spec.variants[name].changes(s)] for s in spec.scenarios},
            Family.CALIBRATION,
        )
        for name in names
    ]
    drive_plans(plans, "calibrate", place, workers)


def _rows(
    spec: CalibrationSpec, names: list[str], place: Path, episodes: int, by_scenario: bool
) -> list[tuple[str, Row]]:
    from lndrl.evaluation.benchmark import METHOD, ResultsFolder, rows_of

    rows = []
    for name in names:
        folder = ResultsFolder(place / name)
        try:
            rows += [(name, row) for row in rows_of(folder, [METHOD], None, episodes)]
            if by_scenario:
                rows += [
                    (f"  {scenario}", row)
                    for scenario in spec.scenarios
                    for row in rows_of(folder, [METHOD], [scenario], episodes)
                ]
        except UserError:
            continue  # not run yet
    return rows
