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

    It only reads, as a dashboard does, and shows its certificate. A learner with --metrics-port
    serves the same by itself. docs/metrics.md has the names.
    """
    from prometheus_client import CollectorRegistry

    from lndrl.cli.signals import say, stop_on_signals
    from lndrl.transport import open_viewer
    from lndrl.transport.status import Status, parse_reply
    from lndrl.view.monitoring import MetricsServer, StatusCollector

    check_endpoint(connect, "--connect")
    security = connecting("dashboard", certs, user, password_file, zenoh)
    viewer = open_viewer(connect, client_transport(connect, namespace), security)

    def look() -> Status:
        return parse_reply(viewer.status(_PATIENCE))[0]

    registry = CollectorRegistry()
    registry.register(StatusCollector(look))
    with stop_on_signals("metrics are no longer served") as stop:
        try:
            server = MetricsServer(address, port, registry)
            server.start()
            say(server.url)
            stop.wait()
            server.close()
        finally:
            viewer.close()
    raise typer.Exit(stop.exit_code)
