"""The truth: place, robot, crowd, laser, odometer, contacts."""

from lndrl.world.laser import beam_bearings
from lndrl.world.layouts import layout_number
from lndrl.world.place import Place
from lndrl.world.world import World, WorldBatch

__all__ = ["Place", "World", "WorldBatch", "beam_bearings", "layout_number"]
