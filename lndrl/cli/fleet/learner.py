"""``lndrl learner``: the learner alone; actors connect from this machine or others."""

from __future__ import annotations

import typer

from lndrl.cli.options import (
    CheckpointName,
    ConfigName,
    LearnerDevice,
    Listen,
    Resume,
    RunName,
    Settings,
    Steps,
    TrustModules,
    check_checkpoint,
    run_overrides,
    trust,
)
from lndrl.cli.runs import choose_run, concluded, going_on
from lndrl.cli.security import (
    Certificates,
    Insecure,
    Namespace,
    PasswordFile,
    Router,
    User,
    Users,
    ZenohFile,
    of_learner,
    transport_overrides,
)
from lndrl.cli.signals import stop_on_signals


def learner(
    config: ConfigName = None,
    listen: Listen = None,
    run: RunName = None,
    resume: Resume = False,
    checkpoint: CheckpointName = None,
    settings: Settings = None,
    steps: Steps = None,
    device: LearnerDevice = None,
    certs: Certificates = None,
    users: Users = None,
    router: Router = None,
    user: User = None,
    password_file: PasswordFile = None,
    namespace: Namespace = None,
    zenoh: ZenohFile = None,
    insecure: Insecure = False,
    trust_modules: TrustModules = None,
) -> None:
    """Run only the learner; actors connect to it from anywhere."""
    check_checkpoint(checkpoint, resume)
    trust(trust_modules)
    overrides = run_overrides(settings, steps, device, listen)
    overrides += transport_overrides(listen, router, namespace)
    chosen, folder = choose_run(config, run, resume, overrides)
    joins = chosen.transport.router
    security = of_learner(joins, certs, users, zenoh, insecure, user, password_file)

    from learner.service import run_learner

    with stop_on_signals("the learner writes a checkpoint") as stop, going_on(folder):
        summary = run_learner(chosen, folder, resume, None, stop, checkpoint, security=security)
    raise typer.Exit(concluded(summary, folder, stop))
