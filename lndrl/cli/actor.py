"""``lndrl actor``: simulated worlds for a learner, here or on another machine."""

from __future__ import annotations

from typing import Annotated

import typer

from lndrl.cli.options import check_device, check_endpoint


def actor(
    connect: Annotated[
        str,
        typer.Option("--connect", metavar="ENDPOINT", help="The learner, tcp/HOST:PORT."),
    ],
    count: Annotated[
        int, typer.Option("--count", min=1, metavar="N", help="Processes to start and keep alive.")
    ] = 1,
    worlds: Annotated[
        int | None,
        typer.Option(
            "--worlds", min=1, metavar="B", help="Worlds per process; else the learner says."
        ),
    ] = None,
    device: Annotated[
        str, typer.Option("--device", help="Where the policy runs: cpu, cuda or cuda:0.")
    ] = "cpu",
) -> None:
    """Run actors that simulate worlds for a learner; the learner hands them the configuration."""
    check_endpoint(connect, "--connect")
    check_device(device)

    from actors.fleet import run_fleet

    raise typer.Exit(run_fleet(connect, count, worlds, device))
