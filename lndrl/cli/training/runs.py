"""``lndrl runs``: which runs there are, how they stand, how two differ, and how one is removed."""

from __future__ import annotations

import json as json_format
import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lndrl.cli.help import say_next
from lndrl.cli.runs import RUNS
from lndrl.errors import UserError
from lndrl.wording import counted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.table import Table

    from learner.run.overview import Overview

runs = typer.Typer(add_completion=False, help="Say which runs there are and how they stand.")

_OUTCOMES = {"arrived": "arrived", "collided": "collided", "lost": "lost", "timeout": "stuck"}
_LONGEST = 40  # characters of a value in a table
_UNITS = ((86_400, "d"), (3_600, "h"), (60, "min"))

Json = Annotated[bool, typer.Option("--json", help="As JSON instead of a table.")]


def _complete_run(incomplete: str) -> list[str]:
    return [p.parent.name for p in RUNS.glob("*/run.json") if p.parent.name.startswith(incomplete)]


def _complete_folder(incomplete: str) -> list[str]:
    return [str(p.parent) for p in RUNS.glob("*/run.json") if str(p.parent).startswith(incomplete)]


@runs.callback(invoke_without_command=True)
def list_runs(context: typer.Context, json: Json = False) -> None:
    """List the runs of this folder, the one that wrote last first, and how each goes on."""
    if context.invoked_subcommand is not None:
        return
    from learner.run.overview import overviews

    found = overviews(RUNS)
    if json:
        typer.echo(json_format.dumps([run.to_dict() for run in found], indent=2))
        return
    if not found:
        typer.echo(f"no run exists in {RUNS}/ here yet; begin one with: lndrl train --run first")
        return
    from lndrl.cli.tables import print_tables

    print_tables(_table(found))
    typer.echo(_next(found[0]))


@runs.command("compare")
def compare(
    first: Annotated[
        Path,
        typer.Argument(metavar="A", help="Run folder.", autocompletion=_complete_folder),
    ],
    second: Annotated[
        Path,
        typer.Argument(metavar="B", help="Another one.", autocompletion=_complete_folder),
    ],
    json: Json = False,
) -> None:
    """Say in what two runs differ: their configurations, and how far each came.

    Training's figures are of the step that both have reached, over the newest episodes of each.
    """
    from learner.run.overview import overview, row_at
    from lndrl.config import differences, load_config
    from lndrl.evaluation.run_metrics import read_metrics

    both = [overview(folder) for folder in (first, second)]
    differ = differences(*(load_config(folder / "config.yaml") for folder in (first, second)))
    step = min(run.steps for run in both)
    at = [row_at(read_metrics(Path(run.folder) / "metrics.jsonl"), step) for run in both]
    episodes = [dict((row or {}).get("episodes", {})) for row in at]
    if json:
        told = {
            "runs": [run.to_dict() for run in both],
            "common_steps": step,
            "at_common_steps": episodes,
            "configuration": differ,
        }
        typer.echo(json_format.dumps(told, indent=2))
        return
    from lndrl.cli.tables import print_tables

    print_tables(_compared(both, step, episodes), *([_differences(both, differ)] if differ else []))
    if not differ:
        typer.echo("their configurations say the same")
    say_next("lndrl", "curves", first, second, "--out", "curves")


@runs.command("rm")
def remove(
    names: Annotated[
        list[str],
        typer.Argument(metavar="NAME...", help="Runs in runs/.", autocompletion=_complete_run),
    ],
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> None:
    """Remove runs with all that they hold; asks first, and never removes one that is training."""
    from learner.run.overview import TRAINING, overview

    chosen = []
    for name in dict.fromkeys(names):
        folder = RUNS / name
        if folder.parent != RUNS or name in (".", ".."):
            raise UserError(f"{name}: name a run as lndrl runs lists it, without a path")
        if folder.is_symlink():
            raise UserError(f"{folder}: is a link; remove it, or what it leads to, by hand")
        run = overview(folder)
        if run.state == TRAINING:
            raise UserError(f"{folder}: a learner is at work there; stop it first")
        chosen.append(run)
    held = ", ".join(f"{run.name} ({counted(run.steps, 'step')})" for run in chosen)
    size = _bytes(sum(run.size for run in chosen))
    if not yes and not typer.confirm(f"remove {held}, {size}, for good?"):
        raise typer.Exit(1)
    for run in chosen:
        try:
            shutil.rmtree(run.folder)
        except OSError as error:
            raise UserError(f"{run.folder}: cannot be removed ({error.strerror})") from None
    typer.echo(f"removed {held}, {size}")
    say_next("lndrl", "runs", then="what is left")


def _table(found: Sequence[Overview]) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title="runs; shares are of the newest episodes", title_justify="left")
    table.add_column("run", overflow="fold")
    for name in ("state", "scenario", "steps"):
        table.add_column(name)
    for name in (*_OUTCOMES.values(), "validated", "size", "wrote"):
        table.add_column(name, justify="right")
    now = time.time()
    for run in found:
        table.add_row(
            escape(run.name),
            run.state,
            escape(run.scenario),
            f"{run.steps:,}" + (f" of {run.total:,}" if run.total else ""),
            *(_percent(getattr(run, name)) for name in _OUTCOMES),
            _percent(run.validated),
            _bytes(run.size),
            f"{_age(now - run.unix)} ago",
        )
    return table


def _next(run: Overview) -> str:
    """What may be done with a run, in a line."""
    from learner.run.overview import DAMAGED, EMPTY, STOPPED, TRAINING

    if run.state == TRAINING:
        return f"next: lndrl dashboard watches {run.name}"
    if run.state == STOPPED:
        return f"next: lndrl train --run {run.name} --resume goes on with {run.name}"
    if run.state == DAMAGED:
        return f"{run.name} is damaged: {run.why}"
    if run.state == EMPTY:
        return f"{run.name} has no checkpoint; lndrl runs rm {run.name} removes it"
    return f"next: lndrl evaluate {run.folder} --episodes 200"


def _compared(both: Sequence[Overview], step: int, episodes: Sequence[Mapping[str, Any]]) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table("", *(escape(run.name) for run in both))
    table.add_row("state", *(run.state for run in both))
    table.add_row("steps", *(f"{run.steps:,}" for run in both))
    table.add_row("episodes", *(f"{run.episodes:,}" for run in both))
    table.add_row("validated arrivals, best", *(_validated(run) for run in both))
    table.add_section()
    for name, word in _OUTCOMES.items():
        table.add_row(f"{word} at step {step:,}", *(_percent(row.get(name)) for row in episodes))
    table.add_row(f"return at step {step:,}", *(_plain(row.get("mean_return")) for row in episodes))
    return table


def _differences(both: Sequence[Overview], differ: Mapping[str, tuple[Any, Any]]) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table("key", *(escape(run.name) for run in both))
    for key, values in differ.items():
        table.add_row(key, *(escape(_short(value)) for value in values))
    return table


def _validated(run: Overview) -> str:
    if run.validated is None or not run.validated_of:
        return "-"
    from lndrl.wilson import wilson_interval

    low, high = wilson_interval(round(run.validated * run.validated_of), run.validated_of)
    return f"{run.validated:.3f} ({low:.3f}-{high:.3f}) of {run.validated_of}"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}%"


def _plain(value: float | None) -> str:
    return "-" if value is None else f"{value:,.0f}"


def _short(value: Any) -> str:
    text = "-" if value is None else str(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


def _bytes(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:,.0f} MB"


def _age(seconds: float) -> str:
    for length, unit in _UNITS:
        if seconds >= length:
            return f"{seconds / length:.0f} {unit}"
    return f"{max(0.0, seconds):.0f} s"
