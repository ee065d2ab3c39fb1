"""``lndrl evaluator``: validation while training, here or on another machine."""

from __future__ import annotations

from typing import Annotated

import typer

from lndrl.cli.options import TrustModules, check_endpoint, trust
from lndrl.cli.security import (
    Certificates,
    Namespace,
    PasswordFile,
    User,
    ZenohFile,
    client_transport,
    connecting,
)


def evaluator(
    connect: Annotated[
        str,
        typer.Option(
            "--connect", metavar="ENDPOINT", help="The learner, tcp/HOST:PORT or tls/HOST:PORT."
        ),
    ],
    certs: Certificates = None,
    user: User = None,
    password_file: PasswordFile = None,
    namespace: Namespace = None,
    zenoh: ZenohFile = None,
    trust_modules: TrustModules = None,
) -> None:
    """Validate the newest weights of a learner, again and again.

    The learner says in how many episodes (learner.validation_episodes), and what share of a core
    that may take (learner.validation_share). lndrl train starts one by itself.
    """
    check_endpoint(connect, "--connect")
    trust(trust_modules)
    transport = client_transport(connect, namespace)
    security = connecting("evaluator", certs, user, password_file, zenoh)
    security.check(connect, listening=False)

    from actors.fleet import run_fleet

    raise typer.Exit(
        run_fleet(connect, 1, security=security, namespace=transport.namespace, role="evaluator")
    )
