"""Live worlds in the dashboard: watching an actor's, and drawing what comes."""

from lndrl.view.dashboard.worlds.onlooker import Onlooker, Watch
from lndrl.view.dashboard.worlds.panel import empty, world_panel

__all__ = ["Onlooker", "Watch", "empty", "world_panel"]
