"""``lndrl certs``: certificates for TLS between learner, actors and dashboards."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.help import say_next
from lndrl.errors import UserError

if TYPE_CHECKING:
    from datetime import datetime

_PLACES = {
    "learner": "the learner's machine",
    "actor": "every actor machine",
    "dashboard": "where dashboards run",
    "evaluator": "where an evaluator runs",
    "site": "the door of a site (lndrl site)",
    "operator": "where somebody watches who may stop the run",
}


def certs(
    out: Annotated[
        Path, typer.Option("--out", metavar="FOLDER", help="Where the files go, e.g. certs.")
    ],
    host: Annotated[
        list[str] | None,
        typer.Option(
            "--host",
            metavar="NAME_OR_ADDRESS",
            help="How others reach the learner; several may follow. This machine always can.",
            show_default=False,
        ),
    ] = None,
    site_host: Annotated[
        list[str] | None,
        typer.Option(
            "--site-host",
            metavar="NAME_OR_ADDRESS",
            help="How a site's actors reach its door (lndrl site); several may follow.",
            show_default=False,
        ),
    ] = None,
    days: Annotated[
        int, typer.Option("--days", min=1, max=3650, metavar="D", help="Days of validity.")
    ] = 365,
    renew: Annotated[
        list[str] | None,
        typer.Option(
            "--renew",
            metavar="ROLE",
            help="New certificates for these roles (learner, actor, dashboard, evaluator, operator,"
            " site), same authority.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Make a certificate authority and a certificate for every role."""
    from lndrl.transport.security import certificates

    hosts, sites = host or [], site_host or []
    if not renew:
        ends = certificates.create(out, hosts, days, site_hosts=sites)
    elif hosts and "learner" not in renew:
        raise UserError("--host: only the learner's certificate holds hosts; add --renew learner")
    elif sites and "site" not in renew:
        raise UserError("--site-host: only a site's certificate holds these; add --renew site")
    else:
        ends = certificates.renew(out, renew, hosts, days, site_hosts=sites)
    _explain(out, ends)


def _explain(folder: Path, ends: dict[str, datetime]) -> None:
    from lndrl.transport.security.certificates import host_names, load_certificate

    typer.echo(f"{folder}: new certificates; copy")
    for role, end in ends.items():
        files = f"ca.pem {role}.pem {role}.key"
        typer.echo(f"  {files:<36}to {_PLACES[role]} (valid until {end:%Y-%m-%d})")
    if "learner" in ends:
        names = ", ".join(host_names(load_certificate(folder / "learner.pem")))
        typer.echo(f"The learner is known as {names}; endpoints must use one of these.")
    typer.echo("ca.key stays here: who has it can make certificates that everybody believes.")
    say_next("lndrl", "learner", "--listen", "tls/0.0.0.0:7447", "--certs", folder)
