"""``lndrl sweep``: ablations of training settings over several seeds."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.again import same_command
from lndrl.cli.completion import complete_sweep
from lndrl.cli.help import say_next
from lndrl.cli.options import TrustModules, trust
from lndrl.cli.runs import RUNS
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.evaluation.sweep import SweepFigures, SweepFolder


def sweep(
    file: Annotated[
        str,
        typer.Argument(
            metavar="SWEEP",
            help="Name of a sweep that comes with the program, e.g. ppo, or YAML file.",
            autocompletion=complete_sweep,
        ),
    ],
    folder: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Where its runs live; default: runs/sweep-NAME."),
    ] = None,
    parallel: Annotated[
        int, typer.Option(min=1, metavar="N", help="Runs side by side; they share the machine.")
    ] = 1,
    table: Annotated[
        bool, typer.Option("--table", help="Only show what is finished; run nothing.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="The figures as JSON.")] = False,
    markdown: Annotated[
        Path | None,
        typer.Option(metavar="FILE.md", help="Write the tables there, between the sweep's marks."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the learning curves.")
    ] = None,
    trust_modules: TrustModules = None,
) -> None:
    """Compare training settings over several seeds; a sweep that stopped goes on.

    Every variant is trained by lndrl train under every seed. Finished runs are kept.
    """
    trust(trust_modules)
    from lndrl.config import find
    from lndrl.evaluation.sweep import SweepFolder, load_sweep, sweep_figures

    chosen = load_sweep(find("sweep", file))
    _check(chosen.name, markdown, plot)
    place = SweepFolder(folder or RUNS / f"sweep-{chosen.name}", chosen)
    place.check()
    code = 0 if table else _work(place, parallel)
    figures = sweep_figures(place)
    if figures.runs or not code:
        _show(figures, json, markdown, plot)
    raise typer.Exit(code)


def _check(name: str, markdown: Path | None, plot: Path | None) -> None:
    from lndrl.view.document import check_document

    if markdown is not None:
        check_document(markdown, "sweep", name)
    if plot is not None and plot.suffix != ".png":
        raise UserError(f"--plot {plot}: must end in .png")
    if plot is not None and not plot.parent.is_dir():
        raise UserError(f"--plot {plot}: the folder {plot.parent} does not exist")


def _work(place: SweepFolder, parallel: int) -> int:
    """Run what is not finished; the exit code."""
    place.sweep.check_start()
    from lndrl.cli.signals import say, stop_on_signals, telling
    from lndrl.evaluation.sweep import Launcher, Work
    from lndrl.view.sweep import SweepDisplay

    display = SweepDisplay(place.sweep.spec.steps)
    with place.locked() as lock, stop_on_signals("running runs leave checkpoints") as stop:
        launch = Launcher(place, lock, parallel)
        work = Work(place, launch, parallel, display.say, display.show)
        with telling(_at_once), display:
            done = work.go(stop)
    if not done:
        say(f"the same command goes on with what {place.path} lacks: {same_command()}")
    return stop.exit_code


def _at_once() -> str:
    return f"what was at work keeps its last checkpoint; go on with: {same_command()}"


def _show(figures: SweepFigures, json: bool, markdown: Path | None, plot: Path | None) -> None:
    if markdown is not None:
        from lndrl.view.document import write_between_marks
        from lndrl.view.sweep import sweep_markdown

        write_between_marks(markdown, "sweep", figures.sweep.name, sweep_markdown(figures))
    if plot is not None:
        from lndrl.view.pictures.learning.sweep_curves import save_sweep

        try:
            save_sweep(figures, plot)
        except OSError as error:
            raise UserError(f"--plot {plot}: cannot be written ({error.strerror})") from None
    if json:
        typer.echo(json_format.dumps(figures.to_dict(), indent=2))
        return
    from lndrl.cli.tables import print_tables
    from lndrl.view.sweep import legend, sweep_tables

    print_tables(*sweep_tables(figures))
    for line in legend(figures):
        typer.echo(line)
    if plot is None:
        name = figures.sweep.name
        say_next("lndrl", "sweep", name, "--table", "--plot", f"sweep-{name}.png")
