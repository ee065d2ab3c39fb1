"""``lndrl doctor``: why a connection to a learner does not work, in sentences."""

from __future__ import annotations

import json as json_format
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.help import say_next
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.doctor import Check

_STYLES = {"ok": "green", "failed": "bold red", "skipped": "dim"}
# Read where no --password-file is given, for services that get their secrets this way.
PASSWORD_VARIABLE = "LNDRL_PASSWORD"


def doctor(
    connect: Annotated[
        str, typer.Option("--connect", metavar="ENDPOINT", help="Where the learner listens.")
    ] = "tcp/127.0.0.1:7447",
    role: Annotated[
        str | None,
        typer.Option(
            "--role",
            metavar="ROLE",
            help="actor, dashboard, evaluator, operator or learner; else every role with a"
            " certificate in --certs.",
            show_default=False,
        ),
    ] = None,
    certs: Annotated[
        Path | None,
        typer.Option(
            "--certs", metavar="FOLDER", help="Certificates of `lndrl certs`.", show_default=False
        ),
    ] = None,
    user: Annotated[
        str | None,
        typer.Option("--user", metavar="NAME", help="E.g. actor-lab3.", show_default=False),
    ] = None,
    password_file: Annotated[
        Path | None,
        typer.Option(
            "--password-file",
            metavar="FILE",
            help=f"Its first line is the password; else the variable {PASSWORD_VARIABLE}.",
            show_default=False,
        ),
    ] = None,
    namespace: Annotated[
        str | None,
        typer.Option("--namespace", metavar="NAME", help="Of a shared router.", show_default=False),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="As one JSON object.")] = False,
) -> None:
    """Say in words why a connection to a learner does not work.

    Tries name, port, TLS, certificates, user, versions and every permission of the role, one
    after another. Exit code 0: all is right, 1: something failed. It disturbs no training.
    """
    from lndrl.doctor import Target, diagnose
    from lndrl.transport.security.access import ROLES

    if role is not None and role not in ROLES:
        raise UserError(f"--role {role}: unknown; write {', '.join(ROLES)}")
    password = _password(user, password_file)
    target = Target(connect, role, certs, user, password, namespace)
    checks = list(diagnose(target))
    right = all(check.state != "failed" for check in checks)
    if json:
        rows = [{"name": c.name, "state": c.state, "text": c.text} for c in checks]
        typer.echo(json_format.dumps({"ok": right, "checks": rows}, indent=2))
    else:
        _show(checks)
        if right:
            service = role if role in ("actor", "evaluator") else "dashboard"
            own = () if certs is None else ("--certs", certs)
            say_next("lndrl", service, "--connect", connect, *own)
    if not right:
        raise typer.Exit(1)


def _show(checks: Sequence[Check]) -> None:
    from rich.table import Table
    from rich.text import Text

    from lndrl.cli.tables import print_tables

    table = Table()
    for column in ("check", "state", "what was found"):
        table.add_column(column)
    for check in checks:
        table.add_row(
            Text(check.name), Text(check.state, style=_STYLES[check.state]), Text(check.text)
        )
    print_tables(table)


def _password(user: str | None, file: Path | None) -> str | None:
    if user is None:
        if file is not None:
            raise UserError("--password-file goes with --user NAME")
        return None
    if file is None:
        password = os.environ.get(PASSWORD_VARIABLE)
        if not password:
            raise UserError(
                f"--user {user} needs --password-file FILE or the variable {PASSWORD_VARIABLE}"
            )
        return password
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise UserError(f"--password-file {file}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise UserError(f"--password-file {file}: is not text") from None
    if not lines or not lines[0].strip():
        raise UserError(f"--password-file {file}: its first line must be the password")
    return lines[0].strip()
