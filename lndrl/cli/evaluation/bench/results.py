"""``lndrl results``: what the bench has found so far, as a page."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.evaluation.bench.benchmark import NAME, RESULTS, results_there
from lndrl.cli.help import say_next
from lndrl.cli.options import BenchName, check_picture, names_in
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark.results import Results


def results(
    source: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="FOLDER",
            help="Results of lndrl benchmark; default: results/benchmark, else those that come"
            " with the program.",
            show_default=False,
        ),
    ] = None,
    methods: Annotated[
        str | None, typer.Option(metavar="M,...", help="Rows; default: all that are there.")
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(
            metavar="M",
            help="The row that others are compared with and goals are for; default: lndrl; where"
            " it is not there, the first row that is, and no goal is judged.",
            show_default=False,
        ),
    ] = None,
    markdown: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.md",
            help="Write the tables there, between <!-- results NAME --> and <!-- end -->; NAME is"
            " the folder's, e.g. v2.",
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png",
            help="Draw arrived, collided and lost of the rows there, beside the paper's.",
        ),
    ] = None,
    spec: BenchName = None,
    json: Annotated[bool, typer.Option("--json", help="Everything as JSON.")] = False,
) -> None:
    """Show results of the bench beside the paper, paired comparisons and the goals.

    Runs nothing.
    """
    from lndrl.config import DEFAULTS, find
    from lndrl.evaluation.benchmark import ResultsFolder, load_benchmark
    from lndrl.evaluation.benchmark.results import gather
    from lndrl.view.document import check_document, write_between_marks

    file = find("bench", spec or DEFAULTS["bench"])
    bench = load_benchmark(file)
    folder = ResultsFolder(source or RESULTS / NAME)
    if source is None:
        folder = results_there(bench, file, folder)
    if markdown is not None:
        check_document(markdown, "results", folder.path.name)
    if picture is not None:
        check_picture(picture, option="--picture")
    found = gather(bench, folder, names_in(methods), reference)
    from lndrl.view.results import results_markdown, results_tables

    if markdown is not None:
        write_between_marks(markdown, "results", folder.path.name, results_markdown(found))
    if picture is not None:
        _draw(found, picture)
    if json:
        typer.echo(json_format.dumps(found.to_dict(), indent=2))
        return
    from lndrl.cli.tables import print_tables

    print_tables(*results_tables(found))
    for note in found.notes():
        typer.echo(note)
    if picture is not None:
        typer.echo(str(picture))
    say_next("lndrl", "report", folder.path, then="the same as a page")


def _draw(results: Results, picture: Path) -> None:
    from lndrl.view.pictures.rates import save_results

    try:
        save_results(results, picture)
    except OSError as error:
        raise UserError(f"--picture {picture}: cannot be written ({error.strerror})") from None
