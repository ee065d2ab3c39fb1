"""A status, fetched when somebody scrapes, as metrics."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from threading import Lock

from prometheus_client.metrics_core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from lndrl.errors import UserError
from lndrl.transport.status import Status
from lndrl.view.monitoring.families import families

_UP = "Whether the learner answers."


class StatusCollector(Collector):
    """Asks ``look`` for the status whenever somebody scrapes; a UserError of it is ``lndrl_up`` 0.

    A status that is the same object as before costs nothing again.
    """

    def __init__(self, look: Callable[[], Status]) -> None:
        self._look = look
        self._lock = Lock()
        self._known: tuple[Status, list[Metric]] | None = None

    def describe(self) -> list[Metric]:
        """Nothing is known before the first scrape."""
        return []

    def collect(self) -> Iterable[Metric]:
        """All metrics of this moment."""
        try:
            status = self._look()
        except UserError:
            return [GaugeMetricFamily("lndrl_up", _UP, 0)]
        with self._lock:
            if self._known is None or self._known[0] is not status:
                self._known = status, [*families(status)]
            return [GaugeMetricFamily("lndrl_up", _UP, 1), *self._known[1]]
