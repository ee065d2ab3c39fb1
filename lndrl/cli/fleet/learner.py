"""``lndrl learner``: the learner alone; actors connect from this machine or others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from lndrl.cli.options import (
    CheckpointName,
    ConfigName,
    LearnerDevice,
    Listen,
    LogTo,
    MetricsAddress,
    MetricsPort,
    Resume,
    RunName,
    Settings,
    Steps,
    TrustModules,
    check_checkpoint,
    metrics_at,
    run_overrides,
    trackers_in,
    trust,
)
from lndrl.cli.ranks import Ranks, asked_for, follow, joined, lead, leading, shared_options
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

if TYPE_CHECKING:
    from lndrl.config import RunConfig
    from lndrl.transport import Security


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
    ranks: Ranks = 1,
    metrics_port: MetricsPort = None,
    metrics_address: MetricsAddress = None,
    log: LogTo = None,
) -> None:
    """Run only the learner; actors connect to it from anywhere."""
    check_checkpoint(checkpoint, resume)
    metrics, trackers = metrics_at(metrics_port, metrics_address), trackers_in(log)
    trust(trust_modules)
    overrides = run_overrides(settings, steps, device, listen)
    overrides += transport_overrides(listen, router, namespace)

    def protection(chosen: RunConfig) -> Security:
        joins = chosen.transport.router
        return of_learner(joins, certs, users, zenoh, insecure, user, password_file)

    team = joined()
    if team is not None and team.rank:
        follow(team, asked_for(config, run, resume, checkpoint, overrides), protection)
        return
    chosen, folder = choose_run(config, run, resume, overrides)
    security = protection(chosen)
    options = shared_options(certs, users, zenoh, insecure, user, password_file, trust_modules)

    from learner.service import run_learner

    with (
        stop_on_signals("the learner writes a checkpoint") as stop,
        going_on(folder),
        leading(team, ranks, options) as team,
    ):
        if team is not None:
            lead(team, chosen, folder, asked_for(config, run, resume, checkpoint, overrides))
        summary = run_learner(
            *(chosen, folder, resume, None, stop, checkpoint),
            security=security,
            team=team,
            metrics=metrics,
            trackers=trackers,
        )
    raise typer.Exit(concluded(summary, folder, stop))
