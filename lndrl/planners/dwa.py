"""The dynamic window approach (Fox, Burgard and Thrun 1997): the paper's classical baseline.

Sees the laser and the goal at the estimated pose, nothing else: people are what the laser shows of
them at this moment, variances are not looked at. Velocities are not bound to the action table. The
paper gives no parameters; these are those with which the authors' group tuned its own DWA for the
same robot (parameters §7.2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lndrl.config import RunConfig
from lndrl.kernels import kernel
from lndrl.models import Count, Model, NonNegative, Positive
from lndrl.navigation import Observation
from lndrl.navigation.observation import SCAN_COUNTS

_STANDING = 1e-3  # m/s, rad/s; slower is not moving


class DWAConfig(Model):
    """Parameters of the planner (GROUP)."""

    linear_acceleration: Positive = Field(5.0, description="m/s², what the window allows")
    angular_acceleration: Positive = Field(5.0, description="rad/s², what the window allows")
    linear_resolution: Positive = Field(
        0.2, ge=0.001, description="m/s between two candidates, at most"
    )
    angular_resolution: Positive = Field(
        0.1, ge=0.001, description="rad/s between two candidates, at most"
    )
    horizon: Positive = Field(1.6, description="s that a candidate is followed")
    goal_weight: NonNegative = Field(1.0, description="per metre from the arc's end to the goal")
    heading_weight: NonNegative = Field(
        0.5, description="per rad that the arc's end looks past the goal (ours, docs/bench.md)"
    )
    velocity_weight: NonNegative = Field(0.05, description="per m/s below the fastest")
    obstacle_weight: NonNegative = Field(0.25, description="per 1/m of the least clearance")
    beam_stride: Count = Field(10, description="every how many beams one counts as an obstacle")


class DWAPlanner:
    """Follows every velocity of the dynamic window for a while and takes the cheapest.

    Cost of a velocity: distance and bearing of the goal from the end of its arc, slowness, and
    closeness to what the laser sees. An arc that touches anything is not taken. A robot that stands
    and would hardly move turns to the freer side until something better is ahead.
    """

    name = "dwa"

    def __init__(self, config: RunConfig, parameters: DWAConfig | None = None) -> None:
        self.parameters = parameters or DWAConfig()
        task, laser = config.task, config.world.laser
        self._period = config.world.tick * config.world.ticks_per_step
        self._limits = (
            min(task.linear_velocities),
            max(task.linear_velocities),
            min(task.angular_velocities),
            max(task.angular_velocities),
        )
        self._radius = config.world.robot_radius
        p = self.parameters
        self._window = (
            p.linear_acceleration, p.angular_acceleration, p.linear_resolution, p.angular_resolution
        )  # fmt: skip
        self._hardly_turning = p.angular_resolution + _STANDING
        self._steps = max(1, round(p.horizon / self._period))
        self._weights = (p.goal_weight, p.heading_weight, p.velocity_weight, p.obstacle_weight)
        self._range_max = laser.range_max
        used = np.arange(0, laser.beams, p.beam_stride)
        bearing = -laser.field_of_view / 2 + used * laser.field_of_view / laser.beams
        self._used = used - laser.beams  # of the newest scan, which is the last
        self._directions = np.stack((np.cos(bearing), np.sin(bearing)), axis=1)
        self._command = np.zeros((0, 2))

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """See ``Planner.reset``: every robot stands. Nothing here is random."""
        self._command = np.zeros((len(worlds), 2))

    def act(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """See ``Planner.act``."""
        chosen = np.empty((len(rows), 2))
        best_velocities(
            self._command[rows], observation.scan, observation.goal, self._used,
            self._directions, self._range_max, self._window, self._limits, self._period,
            self._steps, self._radius, self._weights, chosen,
        )  # fmt: skip
        v, w = chosen.T
        stuck = np.isnan(v) | ((v < _STANDING) & (np.abs(w) <= self._hardly_turning))
        for i in np.flatnonzero(stuck).tolist():
            chosen[i] = self._escape(observation.scan[i, self._used])
        self._command[rows] = chosen
        return chosen

    def _escape(self, scan: NDArray[np.uint16]) -> tuple[float, float]:
        """Nothing leads on: turn on the spot, to the freer side, until something does."""
        ranges = scan * (self._range_max / SCAN_COUNTS)
        half = len(ranges) // 2
        left = ranges[half:].mean() >= ranges[:half].mean()
        return 0.0, self._limits[3] if left else self._limits[2]


@kernel()
def candidates(least, most, resolution):
    """Evenly from ``least`` to ``most`` (n,), both included, no further apart than
    ``resolution``."""
    count = max(1, math.ceil((most - least) / resolution - 1e-9))
    apart = (most - least) / count
    found = np.empty(count + 1)
    for i in range(count):
        found[i] = i * apart + least
    found[count] = most
    return found


@kernel()
def best_velocities(
    commands, scan, goal, used, directions, range_max, window, limits, period, steps, radius,
    weights, out,
):  # fmt: skip
    """``best_velocity`` of n robots out of what each can reach within a period.

    ``commands`` (n, 2) m/s, rad/s are what they drive now, ``scan`` (n, beams) counts, of which
    ``used`` (b,) numbers from the end count as obstacles, along ``directions`` (b, 2); ``goal``
    (n, 2 or more) m in the robot frame, ``range_max`` m; ``window``: accelerations and resolutions,
    linear first; ``limits`` least and most v, least and most w. Writes to ``out`` (n, 2).
    """
    linear_acceleration, angular_acceleration, linear_resolution, angular_resolution = window
    v_least, v_most, w_least, w_most = limits
    dv, dw = linear_acceleration * period, angular_acceleration * period
    metres = range_max / SCAN_COUNTS
    points = np.empty((used.shape[0], 2))
    target = np.empty(2)
    for i in range(min(commands.shape[0], scan.shape[0], goal.shape[0], out.shape[0])):
        hits = 0
        for k in range(min(used.shape[0], directions.shape[0])):
            beam = scan.shape[1] + used[k]
            if not 0 <= beam < scan.shape[1]:
                continue
            reach = scan[i, beam] * metres
            # A beam that ends nowhere is no obstacle.
            if reach < range_max * (1.0 - 1e-6):
                points[hits, 0] = directions[k, 0] * reach
                points[hits, 1] = directions[k, 1] * reach
                hits += 1
        v, w = commands[i]
        target[0], target[1] = goal[i, 0], goal[i, 1]
        best_velocity(
            candidates(max(v_least, v - dv), min(v_most, v + dv), linear_resolution),
            candidates(max(w_least, w - dw), min(w_most, w + dw), angular_resolution),
            target, points[:hits], period, steps, radius, weights, v_most, out[i],
        )  # fmt: skip


@kernel()
def best_velocity(
    linear, angular, goal, points, period, steps, radius, weights, fastest, out
):  # fmt: skip
    """The cheapest of the velocities ``linear`` (V,) m/s x ``angular`` (W,) rad/s.

    Each is followed exactly, along its arc in the robot frame, for ``steps`` periods of ``period``
    s; clearance is looked at after each. ``goal`` (2,) and ``points`` (P, 2) are m in the robot
    frame, ``radius`` m of the robot; ``weights`` are those of goal, heading, velocity, obstacle;
    ``fastest`` m/s is the velocity without a cost. Writes (v, w) to ``out`` (2,), NaN where every
    arc touches a point; of equally cheap ones the first, slower and further to the right.
    """
    goal_weight, heading_weight, velocity_weight, obstacle_weight = weights
    out[0] = out[1] = np.nan
    cheapest = np.inf
    for i in range(linear.shape[0]):
        for j in range(angular.shape[0]):
            v, w = linear[i], angular[j]
            if v < _STANDING and abs(w) < _STANDING:
                continue  # to stand still leads nowhere; turning on the spot is another candidate
            nearest = np.inf
            x = y = 0.0
            for step in range(1, steps + 1):
                turned = w * period * step
                if abs(w) > 1e-9:
                    x, y = v / w * math.sin(turned), v / w * (1.0 - math.cos(turned))
                else:
                    x, y = v * period * step, 0.0
                for k in range(points.shape[0]):
                    dx, dy = points[k, 0] - x, points[k, 1] - y
                    nearest = min(nearest, dx * dx + dy * dy)
            if nearest <= radius * radius:
                continue
            dx, dy = goal[0] - x, goal[1] - y
            past = math.atan2(dy, dx) - w * period * steps
            cost = goal_weight * math.hypot(dx, dy)
            cost += heading_weight * abs(math.atan2(math.sin(past), math.cos(past)))
            cost += velocity_weight * (fastest - v)
            cost += obstacle_weight / math.sqrt(nearest)
            if cost < cheapest:
                cheapest = cost
                out[0], out[1] = v, w
