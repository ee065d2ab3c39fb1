"""``lndrl bench dashboard``: what a viewer costs."""

from lndrl.bench.dashboard.viewer import measure

__all__ = ["measure"]
