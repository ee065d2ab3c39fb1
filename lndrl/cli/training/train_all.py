"""``lndrl train-all``: every learned method of the test bench, one after another."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.again import same_command
from lndrl.cli.help import say_next
from lndrl.cli.options import (
    BenchName,
    LearnerDevice,
    Listen,
    Steps,
    TrustModules,
    count_or_auto,
    names_in,
    run_overrides,
    trust,
)
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark import MethodsFolder


def train_all(
    methods: Annotated[
        str | None,
        typer.Option(metavar="M,...", help="Methods of the bench; default: all that learn."),
    ] = None,
    steps: Steps = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            metavar="SEED",
            help="Another seed than the configurations' own; trains into runs/METHOD-seedSEED.",
        ),
    ] = None,
    actors: Annotated[
        str | None,
        typer.Option(
            parser=count_or_auto, metavar="N|auto", help="Actor processes; auto, unless configured."
        ),
    ] = None,
    device: LearnerDevice = None,
    listen: Listen = None,
    serial: Annotated[
        bool, typer.Option("--serial", help="Each in one process: slower, same bits every time.")
    ] = False,
    spec: BenchName = None,
    trust_modules: TrustModules = None,
) -> None:
    """Train every learned method of the bench; what stopped goes on, what is done is kept.

    Each is trained by lndrl train, with the configuration and into the run
    folder that the bench names.
    """
    if serial and listen is not None:
        raise UserError("--listen does not go with --serial, which nothing can attach to")
    run_overrides(None, None, device, listen)  # refuses what no run could use
    _check_reach(listen)
    trust(trust_modules)
    from lndrl.config import DEFAULTS, find
    from lndrl.evaluation.benchmark import MethodsFolder, load_benchmark, method_runs

    file = find("bench", spec or DEFAULTS["bench"])
    runs = method_runs(load_benchmark(file), file.parent, names_in(methods), steps, seed)
    folder = MethodsFolder(Path(), runs)
    folder.check()
    given = {"--actors": actors, "--device": device, "--listen": listen}
    options = [part for option, value in given.items() if value for part in (option, str(value))]
    raise typer.Exit(_work(folder, [*options, "--serial" if serial else "--no-dashboard"]))


def _check_reach(listen: str | None) -> None:
    """Actors that come from elsewhere would end with the first method."""
    from lndrl.transport.security.identity import is_loopback

    scheme, _, address = (listen or "tcp/127.0.0.1:7447").partition("/")
    if scheme != "tcp" or not is_loopback(address.rpartition(":")[0]):
        raise UserError(
            f"--listen {listen}: all actors are of this machine here; write tcp/127.0.0.1:PORT"
        )


def _work(folder: MethodsFolder, options: list[str]) -> int:
    """Train what is not finished, each with ``options`` of lndrl train; the exit code."""
    from lndrl.cli.signals import say, stop_on_signals, telling
    from lndrl.evaluation.sweep import Run, Trainer, Work, next_job
    from lndrl.view.methods import MethodsDisplay, method_line

    def all_options(run: Run) -> list[str]:
        # A run that goes on has its own configuration, which may be from before the bench's.
        given = [part for setting in settings[run.name] for part in ("--set", setting)]
        return ["--steps", str(run.config.learner.total_steps), *given, *options]

    settings = {run.name: run.settings for run in folder.methods}
    display = MethodsDisplay(folder)
    for run in folder.runs:
        if next_job(folder, run) is None:
            display.say(f"{run.name}: {folder.early(run) or 'has its steps'}, is kept")
    promise = "the method at work leaves a checkpoint"
    with folder.locked() as lock, stop_on_signals(promise) as stop:
        work = Work(folder, Trainer(folder, lock, all_options), 1, display.say, display.show)
        with telling(_at_once), display:
            done = work.go(stop)
    for run in folder.runs:
        goal = run.config.learner.total_steps
        typer.echo(method_line(run.name, goal, folder.newest(run), bool(folder.early(run))))
    if done:
        say_next("lndrl", "benchmark", then="the table")
    else:
        say(f"the same command goes on where this one stopped: {same_command()}")
    return stop.exit_code


def _at_once() -> str:
    return f"the method at work keeps its last checkpoint; go on with: {same_command()}"
