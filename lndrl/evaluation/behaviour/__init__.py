"""How two methods behave otherwise in the same episodes: where they turn, wait and go."""

from lndrl.evaluation.behaviour.course import WAITING, Course, Watcher
from lndrl.evaluation.behaviour.maps import (
    CELL,
    FEW_EPISODES,
    FEW_STEPS,
    MAPS,
    Cells,
    cells_of,
    differences,
)
from lndrl.evaluation.behaviour.report import BehaviourReport, Numbers
from lndrl.evaluation.behaviour.run import Drives, check_map, drive_courses

__all__ = [
    "CELL",
    "FEW_EPISODES",
    "FEW_STEPS",
    "MAPS",
    "WAITING",
    "BehaviourReport",
    "Cells",
    "Course",
    "Drives",
    "Numbers",
    "Watcher",
    "cells_of",
    "check_map",
    "differences",
    "drive_courses",
]
