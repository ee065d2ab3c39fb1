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
        typer.Option(metavar="STEM", help="Writes STEM.png and STEM.csv; default: RUN/curves."),
    ] = None,
) -> None:
    """Draw a run's learning curves and write them as a table."""
    from lndrl.evaluation.run_metrics import read_metrics
    from lndrl.view.pictures.curves import save_curves, write_csv

    if not run.is_dir():
        raise UserError(f"{run}: no such run folder")
    rows = read_metrics(run / "metrics.jsonl")
    stem = out or run / "curves"
    picture, table = stem.with_name(stem.name + ".png"), stem.with_name(stem.name + ".csv")
    try:
        save_curves(rows, picture, title=f"{run.name}: {counted(rows[-1]['steps'], 'step')}")
        write_csv(rows, table)
    except OSError as error:
        raise UserError(f"--out {stem}: cannot be written ({error.strerror})") from None
    typer.echo(f"{picture} and {table}: {counted(len(rows), 'update')}")
