"""``lndrl curves``: a run's learning curves as a picture and as a table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lndrl.errors import UserError
from lndrl.wording import counted


def curves(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder, e.g. runs/first.")],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="STEM",
            help="Writes STEM.png, STEM.csv and what was validated; default: RUN/curves.",
        ),
    ] = None,
) -> None:
    """Draw a run's learning curves and write them as a table."""
    from lndrl.curve import read_curve
    from lndrl.evaluation.run_metrics import read_metrics
    from lndrl.view.pictures.curves import save_curves, value_at, write_csv, write_validated

    if not run.is_dir():
        raise UserError(f"{run}: no such run folder")
    rows = read_metrics(run / "metrics.jsonl")
    curve = read_curve(run / "metrics.jsonl")
    stem = out or run / "curves"
    picture, table = stem.with_name(stem.name + ".png"), stem.with_name(stem.name + ".csv")
    try:
        title = run.name
        if (steps := value_at(rows[-1], "steps")) is not None:
            title += f": {counted(int(steps), 'step')}"
        save_curves(rows, picture, title, validated=curve)
        write_csv(rows, table)
        if curve:
            write_validated(curve, stem.with_name(stem.name + "-validated.csv"))
    except OSError as error:
        raise UserError(f"--out {stem}: cannot be written ({error.strerror})") from None
    validated = f", {counted(len(curve), 'validated version')} in {stem.name}-validated.csv"
    told = f"{picture} and {table}: {counted(len(rows), 'update')}"
    typer.echo(told + (validated if curve else ""))
