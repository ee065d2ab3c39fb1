"""What the policy sees of a robot, and what it answers: one decision at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.localization import Scanner
from lndrl.maps.grid import OccupancyGrid
from lndrl.navigation import Observation, action_table
from lndrl.navigation.observation import (
    SCAN_COUNTS,
    goal_vector,
    pedestrians_in_view,
    push_scan,
)
from lndrl.planners import MapPlanner, PlannerSource, ShieldedPlanner
from lndrl.planners.policy import PolicyPlanner
from lndrl.planners.predictive import PredictivePlanner
from lndrl.robot.driving.belief import Estimate
from lndrl.robot.driving.maps import RobotMap
from lndrl.robot.driving.people import Seen
from lndrl.robot.driving.scans import BaseScan, as_trained
from lndrl.robot.geometry import inverse
from lndrl.robot.messages import Scan

Floats = NDArray[np.float64]

_ONE = np.zeros(1, np.int64)
_HERE = np.zeros(3)
_SPEED_STEP = 0.1
"""m/s and rad/s to which a measured speed is rounded for who plans with it."""


@dataclass(frozen=True)
class Decision:
    """A velocity, and how likely each action was; no ``probabilities`` where nothing ranks them."""

    v: float
    w: float
    probabilities: NDArray[np.floating] | None
    people: Floats
    """(n, 4) those that were seen: x, y, vx, vy in the robot's frame."""


class Pilot:
    """A planner for one robot, under ``config``: what it was trained under.

    Raises UserError for a policy that cannot be loaded.
    """

    def __init__(
        self, source: PlannerSource, config: RunConfig, greedy: bool = False, seed: int = 0
    ) -> None:
        self.config = config
        self.planner = source.build(config, greedy)
        self.actions = action_table(config.task)
        self._seed, self._goals = seed, 0
        self._observation = Observation.zeros_for(1, config)
        self._begun = True
        self._goal, self._yaw_start = np.zeros(2), 0.0
        self._origin = np.zeros(2)

    @property
    def period(self) -> float:
        """s between two decisions, as in training."""
        return float(self.config.world.tick * self.config.world.ticks_per_step)

    def warm_up(self) -> None:
        """Decide once about nothing, so that all is compiled before it matters."""
        laser = self.config.world.laser
        grid = OccupancyGrid(np.pad(np.zeros((38, 38), bool), 1, constant_values=True), 0.1)
        map_ = RobotMap.of_grid("", grid, self.config.world.robot_radius)
        pose = np.array([2.0, 2.0, 0.0])
        bearings = np.linspace(-1.5, 1.5, laser.beams).astype(np.float32)
        ranges = np.full(laser.beams, 1.5, np.float32)
        own = Scan(1, "", -1.5, 3.0 / laser.beams, 0.0, laser.range_max, ranges)
        scan = BaseScan(1, bearings, ranges, own.angle_increment, own, Scanner())
        self.begin(np.array([3.0, 2.0]), pose, map_)
        someone = Seen(1, "", np.ones((1, 2)), np.zeros((1, 2)))
        self.decide(scan, Estimate(1, pose, np.eye(3) * 0.01, pose[None]), someone)
        self._goals = 0

    def begin(self, goal: Floats, pose: Floats, map_: RobotMap) -> None:
        """Drive to ``goal`` (2,) from ``pose`` (3,), in the frame of ``map_``.

        The goal's heading is the one of the start, as in training: none is promised at the end.
        """
        self._goals += 1
        self._goal, self._yaw_start = goal.copy(), float(pose[2])
        self._begun = True
        self.planner.reset(self._seed, [self._goals])
        if isinstance(self.planner, MapPlanner):
            self._origin = np.array(map_.grid.origin)
            self.planner.enter([map_.place(self.config)])

    def decide(
        self,
        scan: BaseScan,
        estimate: Estimate,
        people: Seen | None,
        speed: Floats | None = None,
    ) -> Decision:
        """The velocity for the next period. ``people`` are in the frame of the base; ``speed`` (2,)
        is what it drives now, for planners that count on it.
        """
        seen, laser, task = self._observation, self.config.world.laser, self.config.task
        scale = SCAN_COUNTS / float(laser.range_max)
        push_scan(as_trained(scan, laser), scale, self._begun, seen.scan[0])
        self._begun = False
        goal_vector(
            estimate.pose, estimate.variance, self._goal, self._yaw_start,
            float(task.variance_limit), seen.goal[0],
        )  # fmt: skip
        position = np.zeros((0, 2)) if people is None else people.position
        velocity = np.zeros((0, 2)) if people is None else people.velocity
        seen.pedestrian_count[0] = pedestrians_in_view(
            _HERE, position, velocity, float(task.map_extent), seen.pedestrians[0]
        )
        if isinstance(self.planner, MapPlanner):
            pose = estimate.pose - np.array([*self._origin, 0.0])
            self.planner.hear(pose[None], _ONE)
        if isinstance(self.planner, PredictivePlanner) and speed is not None:
            # In steps, or else no rollouts could be kept.
            self.planner.measured(np.round(speed[None] / _SPEED_STEP) * _SPEED_STEP, _ONE)
        v, w = self.planner.act(seen, _ONE)[0].tolist()
        shown = seen.pedestrians[0, : seen.pedestrian_count[0]].astype(np.float64)
        return Decision(v, w, self._probabilities(), shown)

    def _probabilities(self) -> NDArray[np.floating] | None:
        planner = self.planner
        ranking = planner.planner if isinstance(planner, ShieldedPlanner) else planner
        return ranking.probabilities[0] if isinstance(ranking, PolicyPlanner) else None


def in_base(people: Seen, base_in_frame: Floats) -> Seen:
    """``people`` about the base, which is at ``base_in_frame`` (3,) of their frame."""
    position, velocity = people.within(inverse(base_in_frame))
    return Seen(people.stamp, "", position, velocity)
