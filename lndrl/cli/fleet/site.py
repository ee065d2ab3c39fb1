"""``lndrl site``: the door between a learner and the actors of one place."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from lndrl.cli.options import check_endpoint
from lndrl.cli.security import (
    Certificates,
    Insecure,
    Namespace,
    PasswordFile,
    User,
    ZenohFile,
    client_transport,
    connecting,
)

_GOODBYE = 5.0  # s for actors to hear that the run is done
_TELL = 60.0  # s between two lines of what went through


def site(
    connect: Annotated[
        str,
        typer.Option(
            "--connect", metavar="ENDPOINT", help="The learner, tcp/HOST:PORT or tls/HOST:PORT."
        ),
    ],
    listen: Annotated[
        str,
        typer.Option(
            "--listen", metavar="ENDPOINT", help="Where this site's actors connect to, likewise."
        ),
    ],
    certs: Certificates = None,
    user: User = None,
    password_file: PasswordFile = None,
    namespace: Namespace = None,
    zenoh: ZenohFile = None,
    insecure: Insecure = False,
) -> None:
    """Stand between a learner and the actors of one place, for which every version comes once.

    Actors and evaluators here connect to this instead of the learner; all else stays as it is.
    """
    check_endpoint(connect, "--connect")
    check_endpoint(listen, "--listen")
    upwards = connecting("site", certs, user, password_file, zenoh)
    upwards.check(connect, listening=False)

    from lndrl.cli.signals import say, stop_on_signals
    from lndrl.transport import Security, open_site

    transport = client_transport(listen, namespace)
    door = Security("site", certs, insecure=insecure)
    with stop_on_signals("this site's actors wait until another stands here") as stop:
        found = open_site(connect, transport, upwards, door, say)
        try:
            say(f"actors of this site: lndrl actor --connect {listen}")
            told = time.monotonic()
            while not (stop.is_set() or found.done.is_set()):
                stop.wait(0.2)
                if time.monotonic() - told >= _TELL:
                    told = time.monotonic()
                    say(_line(found.members(), found.cache.fetched, found.cache.served))
            if found.done.is_set():
                say("the run is done")
                stop.wait(_GOODBYE)
        finally:
            found.close()
    raise typer.Exit(stop.exit_code)


def _line(members: int, fetched: int, served: int) -> str:
    from lndrl.wording import counted

    return (
        f"{counted(members, 'actor')} here; {counted(fetched, 'version')} of weights came from the"
        f" learner, {served:,} were handed out"
    )
