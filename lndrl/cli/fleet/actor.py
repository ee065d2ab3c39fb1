"""``lndrl actor``: simulated worlds for a learner, here or on another machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lndrl.cli.options import TrustModules, check_device, check_endpoint, count_or_auto, trust
from lndrl.cli.security import (
    Certificates,
    Namespace,
    PasswordFile,
    User,
    ZenohFile,
    client_transport,
    connecting,
)


def actor(
    connect: Annotated[
        str,
        typer.Option(
            "--connect", metavar="ENDPOINT", help="The learner, tcp/HOST:PORT or tls/HOST:PORT."
        ),
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
    certs: Certificates = None,
    user: User = None,
    password_file: PasswordFile = None,
    namespace: Namespace = None,
    zenoh: ZenohFile = None,
    ledger: Annotated[
        Path | None,
        typer.Option(
            "--ledger", metavar="FILE", help="Append a JSON line per upload made and answered."
        ),
    ] = None,
    trust_modules: TrustModules = None,
) -> None:
    """Run actors that simulate worlds for a learner; the learner hands them the configuration."""
    check_endpoint(connect, "--connect")
    check_device(device)
    trust(trust_modules)
    transport = client_transport(connect, namespace)
    security = connecting("actor", certs, user, password_file, zenoh)
    security.check(connect, listening=False)

    from actors.fleet import run_fleet
    from lndrl.machine.cores import usable_cores

    number = usable_cores() if count == "auto" else int(count)
    raise typer.Exit(
        run_fleet(
            connect,
            number,
            worlds,
            device,
            security=security,
            namespace=transport.namespace,
            ledger=ledger,
        )
    )
