"""Options that say who a command is, whom it lets in, and where it may listen."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.options import check_endpoint
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.config import TransportConfig
    from lndrl.transport import Security

PASSWORD = "LNDRL_PASSWORD"
PANEL = "Security"

Certificates = Annotated[
    Path | None,
    typer.Option(
        "--certs",
        metavar="FOLDER",
        help="Certificates made by lndrl certs; endpoints are then tls/HOST:PORT.",
        rich_help_panel=PANEL,
    ),
]
User = Annotated[
    str | None,
    typer.Option(
        "--user",
        metavar="NAME",
        help=f"Log in under this name; password from --password-file or {PASSWORD}.",
        rich_help_panel=PANEL,
    ),
]
PasswordFile = Annotated[
    Path | None,
    typer.Option(
        "--password-file",
        metavar="FILE",
        help="File that holds the password of --user.",
        rich_help_panel=PANEL,
    ),
]
Users = Annotated[
    Path | None,
    typer.Option(
        "--users",
        metavar="FILE",
        help="Let in only these: lines of user:password, user being actor[-NAME],"
        " dashboard[-NAME], evaluator[-NAME], operator[-NAME] or learner[-NAME].",
        rich_help_panel=PANEL,
    ),
]
ZenohFile = Annotated[
    Path | None,
    typer.Option(
        "--zenoh",
        metavar="FILE",
        help="JSON5 file of zenoh settings, applied after all others.",
        rich_help_panel=PANEL,
    ),
]
Insecure = Annotated[
    bool,
    typer.Option(
        "--insecure",
        help="Listen beyond this machine although nothing protects the connection.",
        rich_help_panel=PANEL,
    ),
]
Namespace = Annotated[
    str | None,
    typer.Option(
        "--namespace",
        metavar="NAME",
        help="Keep runs apart that share a router; the same for learner, actors, dashboards.",
        rich_help_panel=PANEL,
    ),
]
Router = Annotated[
    str | None,
    typer.Option(
        "--router",
        metavar="ENDPOINT",
        help="Join this zenoh router instead of listening.",
        rich_help_panel=PANEL,
    ),
]


def connecting(
    role: str,
    certs: Path | None,
    user: str | None,
    password_file: Path | None,
    overlay: Path | None,
) -> Security:
    """The security of whoever connects; raises UserError for a password that cannot be had."""
    from lndrl.transport import Security
    from lndrl.transport.security.identity import read_password

    password = None
    if password_file is not None:
        password = read_password(password_file)
    elif user is not None:
        password = os.environ.get(PASSWORD) or None
    return Security(role, certs, user, password, overlay=overlay)


def of_learner(
    joins: bool,
    certs: Path | None,
    users: Path | None,
    overlay: Path | None,
    insecure: bool,
    user: str | None = None,
    password_file: Path | None = None,
) -> Security:
    """The security of a learner that listens, or ``joins`` a router; raises UserError."""
    from lndrl.transport import Security

    if joins:
        if users is not None or insecure:
            option = "--insecure" if insecure else "--users"
            raise UserError(f"{option} does not go with a router, which does the listening")
        return connecting("learner", certs, user, password_file, overlay)
    if user is not None or password_file is not None:
        raise UserError(
            "--user and --password-file go with --router; a learner that listens names whom it"
            " lets in with --users"
        )
    return Security("learner", certs, users=users, overlay=overlay, insecure=insecure)


def client_transport(endpoint: str, namespace: str | None) -> TransportConfig:
    """The transport of whoever connects; raises UserError for a bad namespace."""
    from lndrl.config import TransportConfig
    from lndrl.models import validate

    data = {"endpoint": endpoint, "namespace": namespace or ""}
    return validate(TransportConfig, data, "--namespace")


def transport_overrides(listen: str | None, router: str | None, namespace: str | None) -> list[str]:
    """--router and --namespace as ``key=value``; raises UserError."""
    overrides = []
    if router is not None:
        if listen is not None:
            raise UserError("--listen does not go with --router")
        check_endpoint(router, "--router")
        overrides += [f"transport.endpoint={router}", "transport.router=true"]
    if namespace is not None:
        overrides.append(f"transport.namespace={json.dumps(namespace)}")
    return overrides
