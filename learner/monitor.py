"""The learner's own endpoint for Prometheus: what it has told dashboards anyway, served again."""

from __future__ import annotations

from prometheus_client import CollectorRegistry
from prometheus_client.process_collector import ProcessCollector

from learner.status import StatusThread
from lndrl.errors import UserError
from lndrl.transport.status import Status, parse_status
from lndrl.view.monitoring import MetricsServer, StatusCollector


class Monitor:
    """Serves the newest snapshot at ``address`` and ``port``, and this process's CPU and memory.

    It asks nothing of the learner: ``follow`` names the thread that makes the snapshots. Opening it
    occupies the port; raises UserError.
    """

    def __init__(self, address: str, port: int) -> None:
        self._status: StatusThread | None = None
        self._known: tuple[object, Status] | None = None
        registry = CollectorRegistry()
        registry.register(StatusCollector(self._look))
        ProcessCollector(registry=registry)
        self._server = MetricsServer(address, port, registry, "--metrics-port")
        self.url = self._server.url

    def follow(self, status: StatusThread) -> None:
        """Serve what ``status`` publishes from now on."""
        self._status = status
        self._server.start()

    def close(self) -> None:
        """Give the port back."""
        self._server.close()

    def _look(self) -> Status:
        newest = self._status.newest if self._status is not None else None
        if newest is None:
            raise UserError("the learner has not said anything yet")
        if self._known is None or self._known[0] is not newest:
            self._known = newest, parse_status(newest)
        return self._known[1]
