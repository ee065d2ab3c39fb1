"""A planner whose commands go through the guard."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.kernels import expect
from lndrl.localization import compose
from lndrl.navigation import Observation, action_table
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.planners.guard.paths import Guard, GuardConfig, borne_out, explained, judge_paths
from lndrl.planners.interface import MapPlanner, Planner
from lndrl.planners.predictive import PredictivePlanner
from lndrl.planners.shield import RankingPlanner
from lndrl.world import Place
from lndrl.world.odometry import poses_along, velocities

Floats = NDArray[np.float64]


class GuardedPlanner:
    """Lets ``planner``'s command through where it is safe, else the safe action that it likes best.

    A planner that ranks no actions is taken to like what is near to its command, by speed and by
    rate of turning, each as a share of the most that there is. Standing still is always left. Sees
    the newest scan, and takes for walls what the map explains from the pose that the robot hears,
    moved on by what it drove since. Remembers that, and its counts: ``vetoes`` (rows,) control
    steps of each episode of the last ``reset`` in which the planner's own command was vetoed.
    """

    def __init__(
        self, planner: Planner, config: RunConfig, parameters: GuardConfig | None = None
    ) -> None:
        self.parameters = p = parameters or GuardConfig()
        self.name = f"{planner.name}+guard"
        self.vetoes = np.zeros(0, np.int64)
        self.planner = planner
        world, laser = config.world, config.world.laser
        self._tick, self._ticks = world.tick, world.ticks_per_step
        self._limits = world.robot.acceleration.limits
        self._guard = Guard(
            p, world.robot_radius, self._limits, world.tick, world.tick * world.ticks_per_step
        )
        self._actions = action_table(config.task)
        most = np.abs(self._actions).max(axis=0)
        self._scale = np.where(most > 0.0, most, 1.0)
        self._beams = laser.beams
        bearing = laser.field_of_view * (np.arange(laser.beams) / laser.beams - 0.5)
        self._directions = np.stack((np.cos(bearing), np.sin(bearing)), axis=1)
        self._metres = laser.range_max / SCAN_COUNTS
        # A count of the limit is no echo, and rounding must not make one of it.
        self._range_max = laser.range_max - 0.5 * self._metres
        self._delay = config.localization.heard_delay
        self._places: list[Place] = []
        self._poses, self._heard = np.zeros((0, 3)), np.zeros(0, np.int64)
        self._start(0)
        expect(judge_paths, borne_out, explained)

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """See ``Planner.reset``."""
        self._start(len(worlds))
        self._places, self._heard = [], np.zeros(0, np.int64)
        self.planner.reset(seed, worlds)

    def enter(self, places: Sequence[Place]) -> None:
        """See ``MapPlanner.enter``."""
        self._places = list(places)
        if isinstance(self.planner, MapPlanner):
            self.planner.enter(places)

    def hear(self, poses: Floats, rows: NDArray[np.int64]) -> None:
        """See ``MapPlanner.hear``."""
        self._poses, self._heard = np.array(poses, np.float64), np.array(rows)
        if isinstance(self.planner, MapPlanner):
            self.planner.hear(poses, rows)

    def act(self, observation: Observation, rows: NDArray[np.int64]) -> Floats:
        """See ``Planner.act``."""
        wanted, scores = self._wanted(observation, rows)
        commands = wanted.copy()
        for i, row in enumerate(rows):
            safe = self._safe(observation, i, int(row), wanted[i])
            if not safe[0]:
                commands[i] = self._best(scores[i], safe[1:])
            self.vetoes[row] += not safe[0]
        if isinstance(self.planner, PredictivePlanner):
            self.planner.told(commands, rows)
        self._drive(commands, rows)
        return commands

    def _wanted(
        self, observation: Observation, rows: NDArray[np.int64]
    ) -> tuple[Floats, NDArray[np.floating]]:
        """Commands (B, 2) that the planner would give, and how it ranks the actions (B, A)."""
        planner = self.planner
        if isinstance(planner, PredictivePlanner):
            scores = -planner.costs(observation, rows)
            wanted = self._actions[scores.argmax(axis=1)]
            wanted[np.isinf(scores).all(axis=1)] = 0.0  # there is no goal
            return wanted, scores
        if isinstance(planner, RankingPlanner):
            ranked = planner.scores(observation, rows)
            return self._actions[ranked.argmax(axis=1)], ranked
        wanted = np.asarray(planner.act(observation, rows), dtype=np.float64)
        away = np.abs((self._actions - wanted[:, np.newaxis]) / self._scale).sum(axis=2)
        return wanted, -away

    def _best(self, scores: NDArray[np.floating], safe: NDArray[np.bool_]) -> Floats:
        """The highest of the safe actions; standing still, or braking, where there is none."""
        if not safe.any():
            return np.zeros(2)
        chosen: Floats = self._actions[np.where(safe, scores, -np.inf).argmax()]
        return chosen

    def _start(self, count: int) -> None:
        self.vetoes = np.zeros(count, np.int64)
        self._speeds = np.zeros((count, 2))
        self._moves = np.zeros((count, self._delay, 3))  # of the last steps, the newest last

    def _safe(
        self, observation: Observation, i: int, row: int, wanted: Floats
    ) -> NDArray[np.bool_]:
        """Which of the wanted command and the actions are safe, (1 + A,)."""
        ranges = observation.scan[i, -self._beams :] * self._metres
        real = np.empty(len(ranges), np.bool_)
        borne_out(ranges, self._range_max, self.parameters.pair, real)
        echoes = ranges[real, np.newaxis] * self._directions[real]
        candidates = np.concatenate([wanted[np.newaxis], self._actions])
        return self._guard.safe(
            candidates, self._speeds[row], echoes, self._movable(i, row, echoes)
        )

    def _movable(self, i: int, row: int, echoes: Floats) -> NDArray[np.bool_]:
        movable = np.ones(len(echoes), np.bool_)
        if not self._places or i >= len(self._heard) or self._heard[i] != row:
            return movable
        place, pose = self._places[row], self._poses[i]
        for move in self._moves[row]:
            pose = compose(pose, move)
        p = self.parameters
        explained(
            echoes, pose, place.distance, 1.0 / place.grid.resolution, p.map_tolerance,
            p.map_agreement, movable,
        )  # fmt: skip
        return movable

    def _drive(self, commands: Floats, rows: NDArray[np.int64]) -> None:
        """Keep in mind what the robots at ``rows`` drive now."""
        speeds = velocities(self._speeds[rows], commands, self._limits, self._tick, self._ticks)
        self._speeds[rows] = speeds[:, -1]
        if self._delay:
            end = np.array([self._tick * self._ticks])
            # The end of the last tick, not the start of one after it.
            moves = poses_along(speeds, self._tick, end)[:, 0]
            self._moves[rows, :-1] = self._moves[rows, 1:]
            self._moves[rows, -1] = moves
