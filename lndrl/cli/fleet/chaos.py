"""``lndrl chaos``: faults and malformed messages on purpose, and the count of what they cost."""

from __future__ import annotations

import json as json_format
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lndrl.cli.again import same_command
from lndrl.cli.help import say_next
from lndrl.errors import UserError

if TYPE_CHECKING:
    from threading import Event


def chaos(
    minutes: Annotated[
        float, typer.Option(min=0.1, metavar="M", help="How long faults strike.")
    ] = 5.0,
    seed: Annotated[int, typer.Option(min=0, metavar="S", help="Which faults, and when.")] = 1,
    actors: Annotated[
        int, typer.Option(min=1, metavar="N", help="Honest actors, beside one that is not.")
    ] = 2,
    pace: Annotated[
        float, typer.Option(min=1.0, metavar="SECONDS", help="From one fault to the next.")
    ] = 12.0,
    only: Annotated[
        list[str] | None, typer.Option(metavar="KIND", help="Only this fault; can be repeated.")
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option(metavar="KIND", help="Not this fault; can be repeated.")
    ] = None,
    fuzz: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="No faults, but N malformed messages and files."),
    ] = None,
    rate: Annotated[
        float, typer.Option(min=1.0, metavar="R", help="With --fuzz: messages per second, at most.")
    ] = 250.0,
    folder: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Where the run lives; else a temporary folder."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="The figures as JSON.")] = False,
) -> None:
    """Let a run suffer faults on purpose and count that nothing is lost.

    Starts a learner, actors and all else by itself. Exit code 1 when samples were lost or trained
    twice, or when the learner died of itself.
    """
    kinds = _kinds(only or [], without or [])
    place = _place(folder)
    from lndrl.cli.signals import say, stop_on_signals

    good, code, counted = False, 0, "what was counted until then is above"
    try:
        with stop_on_signals("what was counted so far is shown") as stop:
            if fuzz is not None:
                good = _fuzz(fuzz, seed, rate, place, stop, json)
            else:
                options = {"minutes": minutes, "seed": seed, "actors": actors, "pace": pace}
                good = _run({**options, "kinds": kinds}, place, stop, json)
            code = stop.exit_code
    except KeyboardInterrupt:
        say(f"stopped: nothing was counted; begin anew with: {same_command()}{_elsewhere(folder)}")
        raise
    except (TimeoutError, RuntimeError) as error:
        typer.echo(f"lndrl chaos: {error}", err=True)
    except InterruptedError:
        code, counted = stop.exit_code, "there was nothing to count yet"
    finally:
        if folder is None and good:
            shutil.rmtree(place, ignore_errors=True)
        else:
            typer.echo(f"everything is kept in {place}", err=True)
    if code:
        say(f"stopped: {counted}; begin anew with: {same_command()}{_elsewhere(folder)}")
    raise typer.Exit(code or (0 if good else 1))


def _run(options: dict[str, Any], place: Path, stop: Event, json: bool) -> bool:
    from lndrl.chaos.report import report_tables
    from lndrl.chaos.run import ChaosOptions, run_chaos
    from lndrl.cli.tables import print_tables
    from lndrl.view.progress import StatusLine

    with StatusLine() as line:
        report = run_chaos(ChaosOptions(**options), place, stop, line.update)
    if json:
        typer.echo(json_format.dumps(report.to_dict(), indent=2))
    else:
        print_tables(*report_tables(report))
        for words in report.main.examples + report.found.deaths:
            typer.echo(words)
        if report.good:
            say_next("lndrl", "chaos", "--minutes", 60, then="an hour of it")
    return report.good


def _fuzz(count: int, seed: int, rate: float, place: Path, stop: Event, json: bool) -> bool:
    from lndrl.chaos.fuzz import fuzz_tables, run_fuzz
    from lndrl.cli.tables import print_tables
    from lndrl.view.progress import StatusLine

    with StatusLine() as line:
        report = run_fuzz(count, seed, rate, place, stop, line.update)
    if json:
        typer.echo(json_format.dumps(report.to_dict(), indent=2))
    else:
        print_tables(*fuzz_tables(report))
        for words in report.examples:
            typer.echo(words)
        if report.good:
            say_next("lndrl", "chaos", then="faults, beside a training")
    return report.good


def _kinds(only: list[str], without: list[str]) -> set[str]:
    from lndrl.chaos.schedule import KINDS

    for option, names in (("--only", only), ("--without", without)):
        for name in names:
            if name not in KINDS:
                raise UserError(f"{option} {name}: no such fault; known: {', '.join(KINDS)}")
    return (set(only) or set(KINDS)) - set(without)


def _elsewhere(folder: Path | None) -> str:
    """What the next try has to change: a folder that was named is no longer empty."""
    return "" if folder is None else ", with another --folder"


def _place(folder: Path | None) -> Path:
    if folder is None:
        return Path(tempfile.mkdtemp(prefix="lndrl-chaos-"))
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UserError(f"--folder {folder}: must be new or empty")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--folder {folder}: cannot be made ({error.strerror})") from None
    return folder
