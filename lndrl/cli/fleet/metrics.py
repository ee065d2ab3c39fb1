"""``lndrl metrics``: a learner's status for Prometheus."""

from __future__ import annotations

from typing import Annotated

import typer

from lndrl.cli.options import check_endpoint
from lndrl.cli.security import (
    Certificates,
    Namespace,
    PasswordFile,
    User,
    ZenohFile,
    client_transport,
    connecting,
)
from lndrl.errors import UserError

_PATIENCE = 5.0  # s for the learner to answer a scrape


def metrics(
    connect: Annotated[
        str, typer.Option("--connect", metavar="ENDPOINT", help="Where the learner listens.")
    ] = "tcp/127.0.0.1:7447",
    address: Annotated[
        str, typer.Option("--address", metavar="ADDRESS", help="Where Prometheus asks.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option("--port", min=1, max=65535, metavar="PORT", help="Likewise.")
    ] = 9464,
    certs: Certificates = None,
    user: User = None,
    password_file: PasswordFile = None,
    namespace: Namespace = None,
    zenoh: ZenohFile = None,
) -> None:
    """Serve a learner's status as metrics for Prometheus, at http://ADDRESS:PORT/metrics.

    It only reads, as a dashboard does, and shows its certificate. lndrl_actors_wanted_ratio is what
    an autoscaler goes by.
    """
    try:
        from prometheus_client import CollectorRegistry, start_http_server
    except ImportError:
        raise UserError(
            "lndrl metrics needs the package prometheus-client; pip install it, or lndrl's extra"
            " fleet"
        ) from None

    from lndrl.cli.signals import say, stop_on_signals
    from lndrl.transport import open_viewer
    from lndrl.transport.status import Status, parse_reply
    from lndrl.view.exporter import StatusCollector

    check_endpoint(connect, "--connect")
    security = connecting("dashboard", certs, user, password_file, zenoh)
    viewer = open_viewer(connect, client_transport(connect, namespace), security)

    def look() -> Status:
        return parse_reply(viewer.status(_PATIENCE))[0]

    registry = CollectorRegistry()
    registry.register(StatusCollector(look))
    with stop_on_signals("metrics are no longer served") as stop:
        try:
            server, thread = start_http_server(port, address, registry)
        except OSError as error:
            viewer.close()
            why = error.strerror or error
            raise UserError(f"--port {port}: cannot listen at {address} ({why})") from None
        say(f"http://{address}:{port}/metrics")
        stop.wait()
        server.shutdown()
        thread.join(5.0)
        viewer.close()
    raise typer.Exit(stop.exit_code)
