"""``lndrl curves``: a run's learning curves as a picture and as a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.help import say_next
from lndrl.errors import UserError
from lndrl.wording import counted

if TYPE_CHECKING:
    from lndrl.view.pictures.learning.many_curves import Curves


def curves(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...",
            help="Run folders, e.g. runs/first; of a packed folder of results, e.g."
            " docs/results/v2, all trainings that it keeps.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="STEM",
            help="Writes STEM.png, STEM.csv and, of one run, what was validated; default of one"
            " run: RUN/curves.",
        ),
    ] = None,
) -> None:
    """Draw learning curves of one run, or several in one picture, and write them as a table."""
    chosen = list(dict.fromkeys(runs))
    for run in chosen:
        if not run.is_dir():
            raise UserError(f"{run}: no such run folder")
    alone = len(chosen) == 1 and not _is_results(chosen[0])
    if not alone and out is None:
        what = "all its runs" if len(chosen) == 1 else f"{len(chosen)} runs"
        raise UserError(f"--out: say where the curves of {what} go, e.g. --out curves")
    stem = out or chosen[0] / "curves"
    picture, table = stem.with_name(stem.name + ".png"), stem.with_name(stem.name + ".csv")
    try:
        if alone:
            told = _one(chosen[0], picture, table, stem)
        else:
            told = _several(chosen, picture, table)
    except OSError as error:
        raise UserError(f"--out {stem}: cannot be written ({error.strerror})") from None
    typer.echo(f"{picture} and {table}: {told}")
    trained = [path for path in chosen if not _is_results(path)]
    if not trained:
        say_next("lndrl", "results", "--from", chosen[0], then="what the policies were worth")
    elif len(trained) == 2:
        say_next("lndrl", "runs", "compare", *trained, then="in what they differ")
    else:
        say_next("lndrl", "report", trained[0], then="all of it as one page")


def _one(run: Path, picture: Path, table: Path, stem: Path) -> str:
    """Draw and write one run; what was, in words."""
    from lndrl.curve import read_curve
    from lndrl.evaluation.run_metrics import read_metrics
    from lndrl.view.pictures.learning.curves import (
        save_curves,
        value_at,
        write_csv,
        write_validated,
    )

    rows = read_metrics(run / "metrics.jsonl")
    curve = read_curve(run / "metrics.jsonl")
    title = run.name
    if (steps := value_at(rows[-1], "steps")) is not None:
        title += f": {counted(int(steps), 'step')}"
    save_curves(rows, picture, title, validated=curve)
    write_csv(rows, table)
    told = counted(len(rows), "update")
    if not curve:
        return told
    write_validated(curve, stem.with_name(stem.name + "-validated.csv"))
    return f"{told}, {counted(len(curve), 'validated version')} in {stem.name}-validated.csv"


def _several(paths: list[Path], picture: Path, table: Path) -> str:
    """Draw and write several runs together; what was, in words."""
    from lndrl.view.pictures.learning.many_curves import names_of, save_many_curves, write_many_csv

    names = dict(zip(paths, names_of(paths), strict=True))
    found = [run for path in paths for run in _runs_in(path, names[path])]
    if len({run.name for run in found}) < len(found):  # of one name in several folders
        found = [run for path in paths for run in _runs_in(path, names[path], f"{path}: ")]
    save_many_curves(found, picture)
    write_many_csv(found, table)
    updates = sum(len(run.rows) for run in found)
    versions = sum(len(run.validated) for run in found)
    told = f"{counted(len(found), 'run')}, {counted(updates, 'update')}"
    return f"{told}, {counted(versions, 'validated version')}" if versions else told


def _is_results(folder: Path) -> bool:
    from lndrl.evaluation.benchmark import IDENTITY

    return (folder / IDENTITY).is_file()


def _runs_in(folder: Path, name: str, before: str = "") -> list[Curves]:
    """The run of a run folder, called ``name``, or all that a folder of results keeps.

    Of these the name stands behind ``before``.
    """
    from lndrl.curve import read_curve
    from lndrl.evaluation.benchmark import kept_trainings
    from lndrl.evaluation.run_metrics import read_metrics
    from lndrl.view.pictures.learning.many_curves import Curves

    if not _is_results(folder):
        metrics = folder / "metrics.jsonl"
        return [Curves(name, read_metrics(metrics), read_curve(metrics))]
    kept = kept_trainings(folder)
    if not kept:
        raise UserError(
            f"{folder}: keeps no training; lndrl benchmark --pack FOLDER puts there how the "
            "policies were trained that it tested, while their run folders are there"
        )
    names = [each.run for each in kept]
    return [
        Curves(
            before + each.run + (f" {each.short}" if names.count(each.run) > 1 else ""),
            each.rows,
            each.curve,
        )
        for each in kept
    ]
