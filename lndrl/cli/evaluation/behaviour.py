"""``lndrl figures behaviour``: where one method turns, waits and goes otherwise than another."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.again import same_command
from lndrl.cli.help import say_next
from lndrl.cli.notes import say_origins
from lndrl.cli.options import BenchName, TrustModules, check_picture, trust
from lndrl.cli.signals import say, telling
from lndrl.errors import UserError
from lndrl.machine.cores import usable_cores

if TYPE_CHECKING:
    from lndrl.evaluation.behaviour import BehaviourReport, Course, Drives

_METHOD = "A rule, a method of the bench, a run folder, weights or module:Class."
_CELLS = (0.25, 5.0)


def behaviour(
    first: Annotated[str, typer.Argument(metavar="A", help=_METHOD)],
    second: Annotated[str, typer.Argument(metavar="B", help="What it is compared with.")],
    scenario: Annotated[str, typer.Option(metavar="S", help="A scenario of the bench.")] = "hall",
    episodes: Annotated[
        int, typer.Option(min=1, metavar="N", help="The bench's first N; all of both methods'.")
    ] = 100,
    cell: Annotated[
        float, typer.Option(metavar="M", help="Side of the map's cells in metres.")
    ] = 1.0,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Default: behaviour-A-B-S.png.")
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=0, metavar="W", help="Processes; default: one per core; 0: none."),
    ] = None,
    spec: BenchName = None,
    trust_modules: TrustModules = None,
    json: Annotated[bool, typer.Option("--json", help="Numbers and maps as JSON.")] = False,
) -> None:
    """Draw where A turns more, waits more and goes other ways than B in the same episodes."""
    if out is not None:
        check_picture(out)
    if not _CELLS[0] <= cell <= _CELLS[1]:
        raise UserError(f"--cell {cell:g}: must be {_CELLS[0]:g} to {_CELLS[1]:g} metres")
    trust(trust_modules)
    drives = _drives(first, second, scenario, spec)
    courses = _drive(drives, episodes, usable_cores() if workers is None else workers)
    report = _report(drives, courses, cell)
    name = report.scenario
    file = out or Path(f"behaviour-{report.methods[0]}-{report.methods[1]}-{name}.png")
    from lndrl.view.pictures.behaviour import save_behaviour

    try:
        save_behaviour(report, file)
    except OSError as error:
        raise UserError(f"{file}: cannot be written ({error.strerror})") from None
    if json:
        typer.echo(json_format.dumps(report.to_dict(), indent=2))
        say(f"drew {file}")
        return
    _print(report)
    typer.echo(str(file))
    both = ("--methods", f"{first},{second}", "--scenario", scenario)
    say_next("lndrl", "figures", "trajectories", *both, then="an episode of both")


def _drives(first: str, second: str, scenario: str, spec: str | None) -> list[Drives]:
    from lndrl.config import DEFAULTS, find
    from lndrl.evaluation.behaviour import Drives, check_map
    from lndrl.evaluation.benchmark import bench_config, choose, contenders_named, load_benchmark

    if first == second:
        raise UserError(f"{first} and {second} are the same method; name two")
    bench = load_benchmark(find("bench", spec or DEFAULTS["bench"]))
    (place,) = choose(bench.scenarios, [scenario], "scenario")
    found = contenders_named(bench, [first, second])
    say_origins(contender.source for contender in found)
    changes = bench.changes_in(place)
    drives = [
        Drives(contender, bench_config(contender, place, bench.seed, changes))
        for contender in found
    ]
    check_map(drives[0].config)
    return drives


def _drive(drives: list[Drives], episodes: int, workers: int) -> list[list[Course]]:
    from lndrl.evaluation.behaviour import drive_courses
    from lndrl.view.progress import progress_bar

    total = episodes * len(drives)
    ended = 0

    def words() -> str:
        return (
            f"{ended} of {total} episodes have ended and are not kept; no picture was written; "
            f"begin again with: {same_command()}"
        )

    with telling(words), progress_bar(total, "driving for behaviour", "episodes") as advance:

        def note(course: Course) -> None:
            nonlocal ended
            ended += 1
            advance(1, course.outcome)

        return drive_courses(drives, episodes, workers, note)


def _report(drives: list[Drives], courses: list[list[Course]], cell: float) -> BehaviourReport:
    from lndrl.evaluation.behaviour import BehaviourReport
    from lndrl.world import Place

    scenario = drives[0].config.scenario
    first, second = (each.contender.name for each in drives)
    return BehaviourReport(
        (first, second),
        scenario.name,
        Place.build(scenario).grid,
        (courses[0], courses[1]),
        cell,
    )


def _print(report: BehaviourReport) -> None:
    from rich.table import Table

    from lndrl.cli.tables import print_tables
    from lndrl.view.pictures.behaviour import NUMBERS, number_cells

    table = Table(title=f"on {report.scenario}, the same episodes", title_justify="left")
    for i, head in enumerate(NUMBERS):
        table.add_column(head, justify="right" if i else "left")
    for numbers in report.numbers:
        table.add_row(*number_cells(numbers))
    print_tables(table)
