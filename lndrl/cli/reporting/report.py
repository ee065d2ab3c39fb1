"""``lndrl report``: a run or a folder of results as one page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.again import same_command
from lndrl.cli.options import BenchName, TrustModules, WhichCheckpoint, trust
from lndrl.cli.signals import telling
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.view.report.parts import Page

EPISODES = 50
WORST = 6
_MOST = 50


def report(
    subject: Annotated[
        Path,
        typer.Argument(
            metavar="RUN_OR_RESULTS",
            help="Run folder, e.g. runs/first, or results of lndrl benchmark, e.g."
            " results/benchmark.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.html", help="Default: report.html in that folder.", show_default=False
        ),
    ] = None,
    episodes: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help=f"Of a run: episodes that its policy drives for the page; default: {EPISODES};"
            " 0: none.",
            show_default=False,
        ),
    ] = None,
    worst: Annotated[
        int,
        typer.Option(metavar="N", min=0, max=_MOST, help="Pictures in the failure gallery."),
    ] = WORST,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            metavar="SEED",
            help="Of a run's episodes, as in lndrl evaluate; default: 0.",
            show_default=False,
        ),
    ] = None,
    checkpoint: WhichCheckpoint = None,
    workers: Annotated[
        int | None,
        typer.Option(min=0, metavar="W", help="Processes; default: one per core; 0: none."),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(
            metavar="M",
            help="Of results: the row that others are compared with; default: lndrl.",
            show_default=False,
        ),
    ] = None,
    spec: BenchName = None,
    trust_modules: TrustModules = None,
) -> None:
    """Write one page about a run or about results, for any browser.

    One file that asks the network for nothing: it can be sent, kept and printed.
    """
    is_run = _is_run(subject)
    if is_run:
        _refuse(reference=reference, spec=spec, kind="results of lndrl benchmark")
    else:
        _refuse(
            episodes=episodes,
            seed=seed,
            checkpoint=checkpoint,
            workers=workers,
            kind="a run folder",
        )
    file = out or subject / "report.html"
    from lndrl.view.report.page import check_page, write_page

    check_page(file)
    trust(trust_modules)
    with telling(lambda: f"no page was written; begin again with: {same_command()}"):
        if is_run:
            from lndrl.cli.reporting.of_run import Asked, run_page

            count = EPISODES if episodes is None else episodes
            page = run_page(subject, Asked(count, worst, seed or 0, checkpoint, workers))
        else:
            from lndrl.cli.reporting.of_results import results_page

            page = results_page(subject, worst, reference, spec)
        write_page(page, file)
    _say(page, file)


def _say(page: Page, file: Path) -> None:
    from lndrl.wording import counted

    size = file.stat().st_size / 1e6
    typer.echo(f"{file}: {counted(len(page.sections), 'chapter')}, {size:.1f} MB")
    typer.echo(f"next: open {file} in a browser")


def _is_run(folder: Path) -> bool:
    """Whether ``folder`` is a run, else results; raises UserError for neither."""
    if not folder.exists():
        raise UserError(f"{folder}: no such run or results folder")
    if (folder / "run.json").is_file():
        return True
    if (folder / "benchmark.json").is_file():
        return False
    raise UserError(
        f"{folder}: is neither a run folder (it has no run.json) nor results of lndrl benchmark "
        "(no benchmark.json)"
    )


def _refuse(kind: str, **options: object) -> None:
    """Raise UserError for an option that was given and goes with ``kind`` alone."""
    for name, value in options.items():
        if value is not None:
            raise UserError(f"--{name} {value}: goes with {kind}")
