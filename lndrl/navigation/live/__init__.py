"""A world on its way to whoever watches it: snapshots as frames, and back."""

from lndrl.navigation.live.frames import Framer, grid_of, snapshot_of

__all__ = ["Framer", "grid_of", "snapshot_of"]
