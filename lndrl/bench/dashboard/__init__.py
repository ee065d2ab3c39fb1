"""``lndrl bench dashboard``: what a viewer costs."""

from lndrl.bench.dashboard.all import measure

__all__ = ["measure"]
