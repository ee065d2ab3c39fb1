"""One world and the robot's belief about it: one episode of the task at a time.

A control step gives the world one command and lets it run for ``ticks_per_step`` ticks; after
every tick the localization hears odometry and laser (10 Hz, PAPER §IV-A). Then the step is
observed, paid and judged. Ends, in this order: collided, lost, arrived, timeout.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.config import RunConfig, TaskConfig, WorldConfig
from lndrl.localization import AMCL, LikelihoodMap, PerfectLocalization, amcl_beam_stride
from lndrl.navigation.episode import EpisodeRecord, EpisodeTally, Outcome
from lndrl.navigation.observation import (
    SCAN_COUNTS,
    Observation,
    _quantise,
    dequantise,
    goal_vector,
    pedestrians_in_view,
)
from lndrl.navigation.reward import judge, reward_weights
from lndrl.navigation.snapshot import WorldSnapshot
from lndrl.randomness import Stream, stream_state
from lndrl.world import Place, World, beam_bearings


@njit(cache=True, nogil=True)
def _observe(
    ranges,
    scale,
    pose_true,
    position,
    velocity,
    extent,
    pose_estimated,
    variance,
    goal,
    yaw_start,
    variance_limit,
    scan,
    people,
    belief,
):
    """Fill one row of an Observation in a single call; returns the number of people."""
    _quantise(ranges, scale, scan)
    goal_vector(pose_estimated, variance, goal, yaw_start, variance_limit, belief)
    return pedestrians_in_view(pose_true, position, velocity, extent, people)


def steps_limit(world: WorldConfig, task: TaskConfig) -> int:
    """Control steps until an episode is truncated (parameters §4.6), at least 1."""
    return max(1, math.ceil(task.time_limit / (world.tick * world.ticks_per_step) - 1e-9))


def build_surroundings(config: RunConfig) -> tuple[Place, LikelihoodMap]:
    """What all worlds of a process share; raises UserError for an impossible scenario."""
    place = Place.build(config.scenario, config.world.robot_radius)
    return place, LikelihoodMap.build(place.grid, config.localization)


@dataclass(slots=True)
class Transition:
    """Result of one control step; ``parts`` (6,) are the reward's summands."""

    reward: float
    parts: NDArray[np.float64]
    terminated: bool
    truncated: bool
    record: EpisodeRecord | None  # of the episode, when it has ended


class Navigation:
    """One world, its localization and the running episode.

    ``observation`` has the leading shape () and is rewritten in place by ``reset`` and ``step``;
    give a row of a larger Observation to have it filled there. Everything random derives from
    (seed, world_id, episode).
    """

    def __init__(
        self,
        place: Place,
        field: LikelihoodMap,
        config: RunConfig,
        world_id: int,
        observation: Observation | None = None,
    ) -> None:
        self.config = config
        self.place = place
        self.world_id = world_id
        self.seed = config.seed
        self.episode = -1
        self.outcome: str = "unstarted"
        self.world = World(place, config.world)
        laser = config.world.laser
        self.localization: AMCL | PerfectLocalization
        if config.localization.kind == "perfect":
            self.localization = PerfectLocalization()
        else:
            self.localization = AMCL(field, config.localization, laser)
        self.observation = Observation.zeros_for((), config) if observation is None else observation
        self._stride = amcl_beam_stride(laser, config.localization)
        self._bearings = beam_bearings(laser)[:: self._stride].astype(np.float32)
        self._ranges = np.empty(len(self._bearings), np.float32)
        self._variance = np.zeros(3)
        self._scale = SCAN_COUNTS / laser.range_max
        self._weights = reward_weights(config.task.reward)
        self._parts = np.zeros(6)
        self._tally = EpisodeTally()
        self._before = np.zeros((2, 3))  # true and estimated pose before the step
        task = config.task
        self._limits = (task.lost_distance, task.lost_angle, task.arrive_distance)
        self.steps_limit = steps_limit(config.world, config.task)
        self._path = np.zeros((self.steps_limit + 1, 2))
        self._path_estimated = np.zeros((self.steps_limit + 1, 2))

    @property
    def steps(self) -> int:
        """Control steps taken in the episode."""
        return self._tally.steps

    def reset(self, episode: int | None = None) -> None:
        """Start ``episode``, by default the one after the last; observes the start."""
        self.episode = self.episode + 1 if episode is None else episode
        self.outcome = ""
        self._tally.clear()
        self.world.reset(self.seed, self.world_id, self.episode)
        state = stream_state(self.seed, self.world_id, self.episode, Stream.LOCALIZATION)
        self.localization.reset(self.world.start_pose, state)
        self._sense()
        self._observe()
        self._note_path()

    def step(self, v: float, w: float) -> Transition:
        """Drive with ``v`` (m/s) and ``w`` (rad/s) for one control step.

        Raises RuntimeError when no episode runs (before ``reset`` or after an end).
        """
        if self.outcome:
            raise RuntimeError("no episode runs; call reset() first")
        self._before[0] = self.world.pose_true
        self._before[1] = self.localization.pose_estimated
        collided = self._drive(v, w)
        self._observe()
        return self._judge(collided)

    def _drive(self, v: float, w: float) -> bool:
        """Run the ticks of one control step; True when one of them ended in a collision."""
        world = self.world
        pose = world.pose_true
        world.begin_step(v, w)
        last = self.config.world.ticks_per_step - 1
        for tick in range(last + 1):
            x, y = pose[0], pose[1]
            collided = world.tick()
            self._tally.distance += math.hypot(pose[0] - x, pose[1] - y)
            if collided or tick == last:
                self._sense()
                break
            # The policy never sees these scans: only the beams that AMCL uses are cast.
            self._localize(world.scan_sparse(self._stride))
        return collided

    def _sense(self) -> None:
        """A full scan, and its share for the localization."""
        self.scan = self.world.scan()
        self._ranges[:] = self.scan[:: self._stride]
        self._localize(self._ranges)

    def _localize(self, ranges: NDArray[np.float32]) -> None:
        if isinstance(self.localization, PerfectLocalization):
            self.localization.set_truth(self.world.pose_true)
        self.localization.update(self.world.pose_odometry, ranges, self._bearings)
        self._variance[:] = self.localization.variance

    def _observe(self) -> None:
        world, row, task = self.world, self.observation, self.config.task
        row.pedestrian_count[...] = _observe(
            self.scan,
            self._scale,
            world.pose_true,
            world.pedestrian_position,
            world.pedestrian_velocity,
            task.map_extent,
            self.localization.pose_estimated,
            self._variance,
            world.goal,
            world.start_pose[2],
            task.variance_limit,
            row.scan,
            row.pedestrians,
            row.goal,
        )

    def _judge(self, collided: bool) -> Transition:
        """Pay the step and see whether it ends the episode."""
        reward, lost, arrived = judge(
            self._before,
            self.world.pose_true,
            self.localization.pose_estimated,
            self._variance,
            self.world.goal,
            collided,
            self._limits,
            self._weights,
            self._parts,
            self._tally.sums,
        )
        self._tally.steps += 1
        self._note_path()
        outcome = self._end(collided, lost, arrived)
        if outcome is None:
            return Transition(reward, self._parts.copy(), False, False, None)
        self.outcome = outcome
        record = self._tally.record(self.world_id, self.episode, outcome, self.world.time)
        timeout = outcome == "timeout"
        return Transition(reward, self._parts.copy(), not timeout, timeout, record)

    def _end(self, collided: bool, lost: bool, arrived: bool) -> Outcome | None:
        if collided:
            return "collided"
        if lost:
            return "lost"
        if arrived:
            return "arrived"
        return "timeout" if self.steps >= self.steps_limit else None

    def _note_path(self) -> None:
        self._path[self.steps] = self.world.pose_true[:2]
        self._path_estimated[self.steps] = self.localization.pose_estimated[:2]

    def snapshot(self) -> WorldSnapshot:
        """Everything a drawing needs, copied; needs a started episode."""
        config, world, grid = self.config, self.world, self.place.grid
        seen = self.steps + 1
        return WorldSnapshot(
            scenario=config.scenario.name,
            size=config.scenario.size,
            occupied=grid.occupied.copy(),
            resolution=grid.resolution,
            origin=grid.origin,
            world=self.world_id,
            episode=self.episode,
            steps=self.steps,
            time=float(world.time),
            outcome=self.outcome,
            pose_true=world.pose_true.copy(),
            pose_estimated=self.localization.pose_estimated.copy(),
            variance=self._variance.copy(),
            particles=self.localization.particles.copy(),
            start_pose=world.start_pose.copy(),
            goal=world.goal.copy(),
            arrive_distance=config.task.arrive_distance,
            command=world.command.copy(),
            scan=dequantise(self.observation.scan, config.world.laser.range_max),
            field_of_view=config.world.laser.field_of_view,
            range_max=config.world.laser.range_max,
            pedestrian_position=world.pedestrian_position.copy(),
            pedestrian_velocity=world.pedestrian_velocity.copy(),
            leg_position=world.leg_position.copy(),
            pedestrian_radius=config.task.pedestrian_radius,
            leg_radius=config.world.crowd.leg_radius,
            robot_radius=config.world.robot_radius,
            path=self._path[:seen].copy(),
            path_estimated=self._path_estimated[:seen].copy(),
            episode_return=self._tally.episode_return,
        )
