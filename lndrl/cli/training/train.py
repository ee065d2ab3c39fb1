"""``lndrl train``: learner and actors on this machine, or all in one process with --serial."""

from __future__ import annotations

import sys
from typing import Annotated

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
    count_or_auto,
    metrics_at,
    run_overrides,
    trackers_in,
    trust,
)
from lndrl.cli.ranks import Ranks, asked_for, lead, leading, shared_options
from lndrl.cli.runs import choose_run, concluded, going_on
from lndrl.cli.security import (
    Certificates,
    Insecure,
    Namespace,
    Users,
    ZenohFile,
    of_learner,
    transport_overrides,
)
from lndrl.cli.signals import stop_on_signals
from lndrl.errors import UserError


def train(
    config: ConfigName = None,
    actors: Annotated[
        str | None,
        typer.Option(
            "--actors",
            parser=count_or_auto,
            metavar="N|auto",
            help="Actors, each a process of its own; auto, unless configured: as keeps all busy.",
        ),
    ] = None,
    steps: Steps = None,
    run: RunName = None,
    settings: Settings = None,
    resume: Resume = False,
    checkpoint: CheckpointName = None,
    serial: Annotated[
        bool,
        typer.Option("--serial", help="Everything in this process: slower, same bits every time."),
    ] = False,
    listen: Listen = None,
    device: LearnerDevice = None,
    dashboard: Annotated[
        bool | None,
        typer.Option("--dashboard/--no-dashboard", help="Draw the run; default: in a terminal."),
    ] = None,
    certs: Certificates = None,
    users: Users = None,
    namespace: Namespace = None,
    zenoh: ZenohFile = None,
    insecure: Insecure = False,
    trust_modules: TrustModules = None,
    ranks: Ranks = 1,
    metrics_port: MetricsPort = None,
    metrics_address: MetricsAddress = None,
    log: LogTo = None,
) -> None:
    """Train a policy on this machine: one learner and its actors."""
    network = {
        "--listen": listen,
        "--dashboard": dashboard,
        "--certs": certs,
        "--users": users,
        "--zenoh": zenoh,
        "--insecure": insecure,
        "--ranks": ranks > 1,
        "--metrics-port": metrics_port,
        "--log": log,
    }
    if serial and any(network.values()):
        option = next(name for name, value in network.items() if value)
        raise UserError(f"{option} does not go with --serial, which is one process")
    check_checkpoint(checkpoint, resume)
    metrics, trackers = metrics_at(metrics_port, metrics_address), trackers_in(log)
    trust(trust_modules)
    overrides = run_overrides(settings, steps, device, listen)
    overrides += transport_overrides(listen, None, namespace)
    if actors is not None:
        overrides.append(f"actor.count={actors}")
    chosen, folder = choose_run(config, run, resume, overrides)
    from lndrl.cli.training import local

    with stop_on_signals("the learner writes a checkpoint") as stop, going_on(folder):
        if serial:
            summary = local.train_serially(chosen, folder, resume, checkpoint, stop)
        else:
            drawn = sys.stdout.isatty() if dashboard is None else dashboard
            security = of_learner(chosen.transport.router, certs, users, zenoh, insecure)
            options = shared_options(certs, users, zenoh, insecure, trust_modules=trust_modules)
            with leading(None, ranks, options) as team:
                if team is not None:
                    asked = asked_for(config, run, resume, checkpoint, overrides)
                    lead(team, chosen, folder, asked)
                summary = local.train_locally(
                    *(chosen, folder, resume, checkpoint, drawn, stop),
                    security=security,
                    team=team,
                    metrics=metrics,
                    trackers=trackers,
                )
    raise typer.Exit(concluded(summary, folder, stop))
