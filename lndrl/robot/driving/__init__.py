"""Driving a robot by a policy: senses, belief, decisions, and reasons to stand."""

from lndrl.robot.driving.belief import OwnLocalization, RobotLocalization
from lndrl.robot.driving.driver import Driver, DriveView, Tally
from lndrl.robot.driving.frames import mounted
from lndrl.robot.driving.guarding import DriveGuard
from lndrl.robot.driving.maps import RobotMap
from lndrl.robot.driving.pilot import Pilot
from lndrl.robot.driving.reasons import Reason, Stop
from lndrl.robot.driving.senses import Senses, Trust
from lndrl.robot.driving.service import DriveService, Wanted
from lndrl.robot.limits import Limits

__all__ = [
    "DriveGuard",
    "DriveService",
    "DriveView",
    "Driver",
    "Limits",
    "OwnLocalization",
    "Pilot",
    "Reason",
    "RobotLocalization",
    "RobotMap",
    "Senses",
    "Stop",
    "Tally",
    "Trust",
    "Wanted",
    "mounted",
]
