"""Recordings of robots: read, and driven through once more."""

from lndrl.robot.bags.reader import Bag, Recorded
from lndrl.robot.bags.replay import Moment, Replay, replay

__all__ = ["Bag", "Moment", "Recorded", "Replay", "replay"]
