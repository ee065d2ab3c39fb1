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
    check_endpoint,
    learner_device,
)
from lndrl.cli.runs import choose_run
from lndrl.cli.signals import stop_on_signals
from lndrl.errors import UserError


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
    if checkpoint is not None and not resume:
        raise UserError("--checkpoint goes with --resume")
    overrides = list(settings or [])
    if steps is not None:
        overrides.append(f"learner.total_steps={steps}")
    if device is not None:
        overrides.append(learner_device(device))
    if listen is not None:
        overrides.append(f"transport.endpoint={check_endpoint(listen, '--listen')}")
    chosen, folder = choose_run(config, run, resume, overrides)

    from learner.service import run_learner

    with stop_on_signals("the learner writes a checkpoint") as stop:
        summary = run_learner(chosen, folder, resume, None, stop, checkpoint)
    typer.echo(str(summary))
    raise typer.Exit(stop.exit_code)
