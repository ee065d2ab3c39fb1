"""A learner for Prometheus: what its status says, by the names of docs/metrics.md."""

from lndrl.view.monitoring.collector import StatusCollector
from lndrl.view.monitoring.families import wanted_ratio
from lndrl.view.monitoring.server import MetricsServer

__all__ = ["MetricsServer", "StatusCollector", "wanted_ratio"]
