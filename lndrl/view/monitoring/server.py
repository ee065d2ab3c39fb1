"""One address at which metrics are served over HTTP, by one thread that nobody can keep busy."""

from __future__ import annotations

import socket
import socketserver
import time
from threading import Thread
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

from prometheus_client import CollectorRegistry, make_wsgi_app

from lndrl.errors import UserError

_PATIENCE = 5.0  # s for a client to send its request and to take the answer
_PAUSE = 0.05  # s after each answer: however many ask, a core's share is bounded


class MetricsServer:
    """Serves ``registry`` at http://ADDRESS:PORT/metrics from a daemon thread.

    One request at a time and at most 20 a second, because it shares a process with work that
    matters more. Opening it occupies the port; raises UserError, in words that begin with
    ``option``, when it cannot.
    """

    def __init__(
        self, address: str, port: int, registry: CollectorRegistry, option: str = "--port"
    ) -> None:
        try:
            kind = _Server6 if ":" in address else _Server
            self._server = kind((address, port), _Handler)
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise UserError(f"{option} {port}: cannot listen at {address} ({why})") from None
        self._server.set_app(make_wsgi_app(registry, disable_compression=True))
        host = f"[{address}]" if ":" in address else address
        self.url = f"http://{host}:{port}/metrics"
        self._thread = Thread(target=self._server.serve_forever, name="metrics", daemon=True)

    def start(self) -> None:
        """Begin to answer; before, who connects waits."""
        self._thread.start()

    def close(self) -> None:
        """Stop answering and give the port back."""
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join(2 * _PATIENCE)
        self._server.server_close()


class _Server(WSGIServer):
    def server_bind(self) -> None:
        # Not HTTPServer's, which asks name servers what this address is called.
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = self.server_address[:2]  # type: ignore[assignment]
        self.setup_environ()

    def process_request(self, request: Any, client_address: Any) -> None:
        super().process_request(request, client_address)
        time.sleep(_PAUSE)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that left or was too slow is nothing to report."""


class _Server6(_Server):
    address_family = socket.AF_INET6


class _Handler(WSGIRequestHandler):
    timeout = _PATIENCE

    def log_message(self, format: str, *args: Any) -> None:
        """Scrapes every few seconds are no news."""
