"""One world and the robot's belief about it: one episode of the task at a time.

A control step gives the world one command and lets it run for ``ticks_per_step`` ticks; after
every tick the localization hears odometry and laser (10 Hz, PAPER §IV-A). Then the step is
observed, paid and judged. Ends, in this order: collided, lost, arrived, timeout.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.kernels import expect
from lndrl.localization import AMCL, LikelihoodMap, PerfectLocalization
from lndrl.localization.belief import belief_of, motion_noise
from lndrl.navigation.actions import action_table
from lndrl.navigation.batch import KERNELS, NavigationBatch
from lndrl.navigation.episode import EpisodeRecord, EpisodeTally, Outcome
from lndrl.navigation.observation import Observation, dequantise
from lndrl.navigation.reward import REWARD_PARTS, angle_error, position_error
from lndrl.navigation.snapshot import WorldSnapshot
from lndrl.navigation.track import OUTCOME_NAMES, track_of
from lndrl.navigation.training.replicas import draw_anew
from lndrl.randomness import State, Stream, episode_states, uniform
from lndrl.world import Place, World, layout_number


def build_surroundings(config: RunConfig, layout: int = 0) -> tuple[Place, LikelihoodMap]:
    """What all worlds of a process share, for one of many layouts in ``layout``.

    Raises UserError for an impossible scenario.
    """
    expect(*KERNELS)
    place = Place.build(
        config.scenario, config.world.robot_radius, layout, config.task.arrive_distance
    )
    return place, LikelihoodMap.build(place.grid, config.localization, config.world.laser)


def layout_of(config: RunConfig, world_id: int, episode: int, seed: int | None = None) -> int:
    """The layout that an episode of a world is played in; 0 for a scenario that has but one.

    ``seed`` is that of the world, by default the run's.
    """
    layouts = config.scenario.layouts
    if layouts is None:
        return 0
    era = episode // layouts.episodes
    seed = config.seed if seed is None else seed
    return layout_number(config.scenario, seed, world_id + (era << 40))


@dataclass(slots=True)
class Transition:
    """Result of one control step; ``parts`` are the reward's summands, see ``part_names``."""

    reward: float
    parts: NDArray[np.float64]
    terminated: bool
    truncated: bool
    record: EpisodeRecord | None  # of the episode, when it has ended


class Navigation:
    """One world, its localization and the running episode.

    ``observation`` has the leading shape () and is rewritten in place by ``reset`` and ``step``;
    give a row of a larger Observation to have it filled there. Everything random derives from
    (seed, world_id, episode). ``batch`` is the memory to live in, as its world ``index``; by
    default an own one.

    A copy (``copy.deepcopy``, ``pickle``) has memory of its own and goes on bit for bit the same.
    """

    def __init__(
        self,
        place: Place,
        field: LikelihoodMap,
        config: RunConfig,
        world_id: int,
        observation: Observation | None = None,
        batch: NavigationBatch | None = None,
        index: int = 0,
    ) -> None:
        self.config = config
        self.world_id = world_id
        self.seed = config.seed
        self.episode = -1
        if batch is None:
            if observation is None:
                observation = Observation.zeros_for((), config)
            batch, index = NavigationBatch(place, field, config, 1, observation.reshape(1)), 0
        self._layout = 0
        self._settle(batch, index)

    def __getstate__(self) -> dict[str, Any]:
        # All else are views of the batch's arrays, which a copy would part from them.
        kept = ("config", "world_id", "seed", "episode", "_layout", "batch", "index")
        return {name: vars(self)[name] for name in kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._settle(self.batch, self.index)

    def show_in(self, observation: Observation) -> None:
        """Move to ``observation`` (1, ...), for a world that has a batch of its own."""
        observation.put(slice(None), self.batch.observation)
        self.batch.show_in(observation)
        self.observation = observation.take((0, Ellipsis))

    def _settle(self, batch: NavigationBatch, index: int) -> None:
        """Live as world ``index`` of ``batch``."""
        self.batch = batch
        self.index = index
        self.place = batch.place
        self.steps_limit = batch.task.steps_limit
        self.observation = batch.observation.take((index, Ellipsis))
        self.world = World(batch.place, self.config.world, batch.world, index)
        self._belief = belief_of(batch.beliefs, index)
        self.localization: AMCL | PerfectLocalization
        if batch.perfect:
            self.localization = PerfectLocalization(self._belief.pose)
        else:
            self.localization = AMCL(
                batch.field,
                batch.localization,
                self.config.world.laser,
                self._belief,
                batch.shared.scratch,
                batch.shared.bins,
            )
        self.track = track_of(batch.tracks, index)
        self.scan = self.track.scan
        self._tally = EpisodeTally(self.track)
        self._command = np.zeros((1, 2))
        self._actions = action_table(self.config.task)

    def _move_to(self, layout: int) -> None:
        """Live in another layout from now on, in memory of its own."""
        place, field = build_surroundings(self.config, layout)
        row = self.observation.reshape(1)
        self._settle(NavigationBatch(place, field, self.config, 1, row), 0)
        self._layout = layout

    @property
    def steps(self) -> int:
        """Control steps taken in the episode."""
        return int(self.track.steps[0])

    @property
    def pose_heard(self) -> NDArray[np.float64]:
        """(3,) the estimate that the robot acts on, ``localization.heard_delay`` steps old."""
        return self.track.reports[-1, :3]

    @property
    def pose_judged(self) -> NDArray[np.float64]:
        """(3,) the true pose that ``pose_heard`` is judged by, see ``task.judged_moment``."""
        return self.track.reports[-1, 6:]

    @property
    def outcome(self) -> str:
        """How the episode ended; "" while it runs, "unstarted" before the first."""
        return OUTCOME_NAMES[self.track.outcome[0]] if self.episode >= 0 else "unstarted"

    def reset(self, episode: int | None = None) -> None:
        """Start ``episode``, by default the one after the last; observes the start."""
        self.episode = self.episode + 1 if episode is None else episode
        layout = layout_of(self.config, self.world_id, self.episode, self.seed)
        if layout != self._layout:
            self._move_to(layout)
        states = episode_states(self.seed, self.world_id, self.episode)
        self.world.reset(self.seed, self.world_id, self.episode, states)
        self.localization.reset(self.world.start_pose, states[Stream.LOCALIZATION])
        self._randomize(states[Stream.SETTINGS])
        self.batch.begin(self.index, states[Stream.REPLICAS])

    def go_on(self, states: State) -> None:
        """Play on as the next episode, with ``episode_states`` ``states`` from now on.

        For a world whose arrays have been put back to an earlier moment of its episode.
        """
        self.episode += 1
        self.world.robot.laser_random[:] = states[Stream.LASER]
        self.world.robot.odometry_random[:] = states[Stream.ODOMETRY]
        self._belief.random[:] = states[Stream.LOCALIZATION]
        draw_anew(self.batch.replicas, self.index, states[Stream.REPLICAS])
        if self.batch.terms is not None:
            self.batch.terms.begin(self.index)

    def _randomize(self, state: State) -> None:
        """Draw what ``config.randomize`` names; all else keeps the batch's settings."""
        between = self.config.randomize
        # Both are drawn, so that neither key changes what the other one draws.
        slip, noise = uniform(state), uniform(state)
        if between.odometry_deviation is not None:
            least, most = between.odometry_deviation
            self.world.robot.deviation[0] = least + slip * (most - least)
        if between.motion_noise is not None:
            least, most = between.motion_noise
            factor = least * (most / least) ** noise
            self._belief.alpha[:] = factor * motion_noise(self.batch.localization)

    def step(self, v: float, w: float) -> Transition:
        """Drive with ``v`` (m/s) and ``w`` (rad/s) for one control step.

        Raises RuntimeError when no episode runs (before ``reset`` or after an end).
        """
        if self.outcome:
            raise RuntimeError("no episode runs; call reset() first")
        self._drive(v, w)
        self.batch.judge(self.index, 1)
        return self.transition()

    def _drive(self, v: float, w: float) -> None:
        self._command[0] = v, w
        self.batch.drive(self._command, self.index)

    def transition(self) -> Transition:
        """The control step that has just been judged."""
        outcome = self.outcome
        timeout = outcome == "timeout"
        return Transition(
            reward=float(self.track.reward[0]),
            parts=self.parts(),
            terminated=bool(outcome) and not timeout,
            truncated=timeout,
            record=self.record() if outcome else None,
        )

    @property
    def part_names(self) -> tuple[str, ...]:
        """Names of the reward's summands: the compiled ones, then terms of the user's own."""
        return (*REWARD_PARTS, *(self.batch.terms.names if self.batch.terms else ()))

    def parts(self) -> NDArray[np.float64]:
        """The reward's summands in the last step, see ``part_names``."""
        terms = self.batch.terms
        if terms is None:
            return self.track.parts.copy()
        return np.concatenate((self.track.parts, terms.paid[self.index]))

    def _own_sums(self) -> dict[str, float]:
        """What reward terms of the user's own have paid in the episode, by name."""
        terms = self.batch.terms
        if terms is None:
            return {}
        return dict(zip(terms.names, terms.sums[self.index].tolist(), strict=True))

    def record(self) -> EpisodeRecord:
        """Of the episode that has just ended."""
        outcome = cast(Outcome, self.outcome)
        return self._tally.record(
            self.world_id, self.episode, outcome, self.world.time, self._own_sums()
        )

    def _action_taken(self) -> int:
        """Number of the action that is the last command; -1 where it is none of the table."""
        near = np.abs(self._actions - self.world.command).max(axis=1)
        return int(near.argmin()) if near.min() < 1e-6 else -1

    @property
    def layout(self) -> int:
        """The layout that the episode is played in; 0 for a scenario that has but one."""
        return self._layout

    def snapshot(self, probabilities: NDArray[np.floating] | None = None) -> WorldSnapshot:
        """Everything a drawing needs, copied; needs a started episode.

        ``probabilities`` (A,) are those that the last action was drawn by.
        """
        config, world, grid = self.config, self.world, self.place.grid
        heard, judged = self.pose_heard, self.pose_judged
        seen, said = self.steps + 1, probabilities if self.steps else None
        return WorldSnapshot(
            scenario=config.scenario.name,
            size=grid.size,
            occupied=grid.occupied.copy(),
            resolution=grid.resolution,
            origin=grid.origin,
            world=self.world_id,
            episode=self.episode,
            steps=self.steps,
            time=world.time,
            outcome=self.outcome,
            pose_true=world.pose_true.copy(),
            pose_estimated=self.localization.pose_estimated.copy(),
            variance=self.track.variance.copy(),
            particles=self.localization.particles.copy(),
            start_pose=world.start_pose.copy(),
            goal=world.goal.copy(),
            arrive_distance=config.task.arrive_distance,
            command=world.command.copy(),
            scan=dequantise(
                self.observation.scan[-config.world.laser.beams :], config.world.laser.range_max
            ),
            field_of_view=config.world.laser.field_of_view,
            range_max=config.world.laser.range_max,
            pedestrian_position=world.pedestrian_position.copy(),
            pedestrian_velocity=world.pedestrian_velocity.copy(),
            leg_position=world.leg_position.copy(),
            pedestrian_radius=config.task.pedestrian_radius,
            leg_radius=config.world.crowd.leg_radius,
            robot_radius=config.world.robot_radius,
            path=self.track.path[:seen].copy(),
            path_estimated=self.track.path_estimated[:seen].copy(),
            episode_return=self._tally.episode_return + sum(self._own_sums().values()),
            pose_odometry=world.pose_odometry.copy(),
            covariance=self.localization.covariance.copy(),
            weights=self.localization.weights.copy(),
            position_error=float(position_error(judged, heard)),
            angle_error=float(angle_error(judged, heard)),
            lost_distance=config.task.lost_distance,
            lost_angle=config.task.lost_angle,
            part_names=self.part_names,
            parts=self.parts() if self.steps else np.zeros(len(self.part_names)),
            actions=self._actions,
            probabilities=np.zeros(0) if said is None else said.astype(np.float64),
            action=self._action_taken() if self.steps else -1,
        )
