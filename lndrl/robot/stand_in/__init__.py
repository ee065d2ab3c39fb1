"""A robot that is not there: our world behind ROS 2's topics, for rehearsals."""

from lndrl.robot.stand_in.body import Body
from lndrl.robot.stand_in.conditions import Conditions, Mute
from lndrl.robot.stand_in.judge import DrivenEpisode
from lndrl.robot.stand_in.service import Rehearsal, StandIn

__all__ = ["Body", "Conditions", "DrivenEpisode", "Mute", "Rehearsal", "StandIn"]
