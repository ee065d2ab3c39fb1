"""``lndrl up``: learner and actors on the hosts that a file names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lndrl.errors import UserError

ClusterFile = Annotated[
    Path, typer.Argument(metavar="CLUSTER.yaml", help="Which host does what; deploy/cluster.md.")
]


def up(
    cluster: ClusterFile,
    detach: Annotated[
        bool, typer.Option("--detach", help="Return once all run; lndrl down ends them.")
    ] = False,
) -> None:
    """Start learner and actors on the hosts that a file names, watch them, and end them together.

    A run that exists on the learner's host goes on from its newest checkpoint.
    """
    check_packages()

    from lndrl.cli.signals import say, stop_on_signals
    from lndrl.placement.cluster import load_cluster
    from lndrl.placement.launch import up as start

    found = load_cluster(cluster)
    with stop_on_signals("ending actors, then the learner, which leaves a checkpoint") as stop:
        code = start(found, detach, stop, say)
    raise typer.Exit(stop.exit_code or code)


def check_packages() -> None:
    """Raise UserError where what this command needs is not installed."""
    try:
        import asyncssh  # noqa: F401
        import submitit  # noqa: F401
    except ImportError as error:
        raise UserError(
            f"lndrl up needs the package {error.name}; pip install asyncssh submitit, or lndrl's"
            " extra fleet"
        ) from None
