"""``lndrl actor``: simulated worlds for a learner, here or on another machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lndrl.cli.options import check_device, check_endpoint, count_or_auto


def actor(
    connect: Annotated[
        str,
        typer.Option("--connect", metavar="ENDPOINT", help="The learner, tcp/HOST:PORT."),
    ],
    count: Annotated[
        str,
        typer.Option(
            "--count",
            parser=count_or_auto,
            metavar="N|auto",
            help="Processes to start and keep alive; auto: one per core.",
        ),
    ] = "1",
    worlds: Annotated[
        int | None,
        typer.Option(
            "--worlds", min=1, metavar="B", help="Worlds per process; else the learner says."
        ),
    ] = None,
    device: Annotated[
        str, typer.Option("--device", help="Where the policy runs: cpu, cuda, cuda:0 or auto.")
    ] = "cpu",
    ledger: Annotated[
        Path | None,
        typer.Option(
            "--ledger", metavar="FILE", help="Append a JSON line per upload made and answered."
        ),
    ] = None,
) -> None:
    """Run actors that simulate worlds for a learner; the learner hands them the configuration."""
    check_endpoint(connect, "--connect")
    check_device(device)

    from actors.balance import usable_cores
    from actors.fleet import run_fleet

    number = usable_cores() if count == "auto" else int(count)
    raise typer.Exit(run_fleet(connect, number, worlds, device, ledger))
