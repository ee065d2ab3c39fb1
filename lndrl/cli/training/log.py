"""``lndrl log``: a run's figures to Weights & Biases or MLflow, afterwards or while it trains."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from lndrl.cli.help import say_next
from lndrl.errors import UserError
from lndrl.wording import counted


def log(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder, e.g. runs/first.")],
    to: Annotated[str, typer.Option("--to", metavar="wandb|mlflow", help="Where to.")],
    follow: Annotated[
        bool, typer.Option("--follow", help="Go on as long as a learner trains there.")
    ] = False,
) -> None:
    """Send a run's figures to Weights & Biases or MLflow; again sends what is new.

    Both go by their own settings: WANDB_MODE=offline, WANDB_PROJECT, MLFLOW_TRACKING_URI,
    MLFLOW_EXPERIMENT_NAME (docs/metrics.md). lndrl train --log wandb does this while it trains.
    """
    from learner.run.overview import is_held
    from lndrl.cli.signals import say, stop_on_signals
    from lndrl.view.tracking.publish import (
        TrackerError,
        check_tracker,
        facts_of,
        open_tracker,
        publish,
    )

    check_tracker(to, "--to")
    facts = facts_of(run)
    if follow:
        os.nice(10)  # beside a training, which comes first
    with stop_on_signals("what there is, is sent") as stop:
        try:
            sent = publish(
                facts,
                lambda: open_tracker(to, facts),
                (lambda: is_held(run)) if follow else None,
                stop,
                say,
            )
        except TrackerError as error:
            again = f"lndrl log {run} --to {to} sends the rest"
            raise UserError(f"{error}; not all was sent; {again}") from None
    typer.echo(f"{counted(sent, 'row')} sent")
    say_next("lndrl", "report", run, then="one page about it")
