"""``lndrl learner``: the learner alone; actors connect from this machine or others."""

from __future__ import annotations

import typer

from lndrl.cli.options import (
    CheckpointName,
    ConfigFile,
    LearnerDevice,
    Listen,
    Resume,
    RunName,
    Settings,
    Steps,
    check_checkpoint,
    run_overrides,
)
from lndrl.cli.runs import choose_run
from lndrl.cli.signals import stop_on_signals


def learner(
    config: ConfigFile = None,
    listen: Listen = None,
    run: RunName = None,
    resume: Resume = False,
    checkpoint: CheckpointName = None,
    settings: Settings = None,
    steps: Steps = None,
    device: LearnerDevice = None,
) -> None:
    """Run only the learner; actors connect to it from anywhere."""
    check_checkpoint(checkpoint, resume)
    overrides = run_overrides(settings, steps, device, listen)
    chosen, folder = choose_run(config, run, resume, overrides)

    from learner.service import run_learner

    with stop_on_signals("the learner writes a checkpoint") as stop:
        summary = run_learner(chosen, folder, resume, None, stop, checkpoint)
    typer.echo(str(summary))
    raise typer.Exit(stop.exit_code)
