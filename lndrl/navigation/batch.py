"""Memory of many worlds of one place with their beliefs and episodes, and their common step."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.config import ReplicaConfig, RunConfig
from lndrl.localization import LikelihoodMap, amcl_beam_stride
from lndrl.localization.belief import (
    belief_of,
    make_beliefs,
    make_field,
    make_scratch,
    make_settings,
    room_for,
)
from lndrl.localization.bins import make_bins
from lndrl.localization.resampling import kld_limits
from lndrl.localization.update import reset_belief
from lndrl.maps.paths import leg_keeps
from lndrl.maps.raycast import sample_field
from lndrl.navigation.observation import SCAN_COUNTS, Observation
from lndrl.navigation.privileged.floats import NAMES
from lndrl.navigation.privileged.kernel import know_worlds
from lndrl.navigation.reward import pose_error_limit, reward_weights
from lndrl.navigation.step import Filter, Machine, Task, Views, drive_worlds, judge_worlds, pack
from lndrl.navigation.terms import own_terms
from lndrl.navigation.track import RUNNING, make_tracks
from lndrl.navigation.training.replicas import draw_anew, make_replicas, take_up
from lndrl.randomness import State, uniform
from lndrl.world import Place, WorldBatch, beam_bearings
from lndrl.world.orca_walls import insert_edges
from lndrl.world.pedestrians import place_legs
from lndrl.world.place import draw_free
from lndrl.world.placement import place_people
from lndrl.world.social_force import relaxation

KERNELS = (
    draw_free, insert_edges, leg_keeps, sample_field, uniform, relaxation, room_for,
    place_people, place_legs, reset_belief, drive_worlds, judge_worlds,
)  # fmt: skip
"""What places and worlds call from Python, as they do; all the rest is called by these."""


class NavigationBatch:
    """``worlds`` worlds of one place, stepped together by compiled code.

    ``observation`` (worlds, ...) is where they show themselves. Working memory is shared by all of
    them: one thread at a time. Raises ValueError for an observation of other sizes.
    """

    def __init__(
        self,
        place: Place,
        field: LikelihoodMap,
        config: RunConfig,
        worlds: int,
        observation: Observation,
    ) -> None:
        laser, localization = config.world.laser, config.localization
        _check_room(observation, worlds, config)
        self.perfect = localization.kind == "perfect"
        if self.perfect:  # beliefs without particles worth speaking of
            fewest = {"min_particles": 1, "max_particles": 1}
            localization = localization.model_copy(update=fewest)
        self.localization = localization
        self.place = place
        self.field = field
        self.observation = observation
        self.world = WorldBatch(place, config.world, worlds)
        self.beliefs = make_beliefs(worlds, localization)
        limit = config.steps_limit
        self.tracks = make_tracks(worlds, laser.beams, limit, localization.heard_delay)
        stride = amcl_beam_stride(laser, config.localization)
        bearings = beam_bearings(laser)[::stride].astype(np.float32)
        self.shared = Filter(
            scratch=make_scratch(localization, laser),
            bins=make_bins(localization),
            limits=kld_limits(localization),
            field=make_field(field),
            settings=make_settings(localization, laser),
            ranges=np.zeros(len(bearings), np.float32),
            bearings=bearings,
            stride=stride,
            perfect=self.perfect,
            heard=_heard(config),
        )
        self.task = _task(config)
        replicas = ReplicaConfig() if self.perfect else config.replicas
        self.replicas = make_replicas(worlds, replicas, localization)
        self.terms = own_terms(config, worlds)
        self.worlds = worlds
        self._still = np.zeros((1, 2))
        self._packed = self._pack()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_packed"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        # What kernels are handed names the same arrays once more: a copy's must name its own.
        vars(self).update(state)
        self._packed = self._pack()

    def show_in(self, observation: Observation) -> None:
        """Show the worlds in ``observation`` (worlds, ...) from now on, which has their state."""
        self.observation = observation
        self._packed = self._pack()

    def _pack(self) -> Any:
        shown = self.observation
        return pack(
            Machine(
                self.world.robots,
                self.world.people,
                self.beliefs,
                self.tracks,
                Views(shown.scan, shown.pedestrians, shown.pedestrian_count, shown.goal),
                self.world.setting,
                self.world.scratch,
                self.shared,
                self.task,
                self.replicas,
            )
        )

    def drive(self, commands: NDArray[np.float64], first: int = 0) -> None:
        """Drive and sense for one control step; ``commands`` (n, 2) go to n worlds from ``first``
        on. Raises ValueError for worlds that are not there.
        """
        if commands.ndim != 2 or commands.shape[1] != 2:
            raise ValueError(f"commands must be (n, 2), not {commands.shape}")
        self._check_worlds(first, len(commands))
        if self.terms is not None:
            self.terms.before(self, first, len(commands))
        drive_worlds(self._packed, first, commands, self.task.ticks)

    def judge(self, first: int = 0, worlds: int | None = None) -> None:
        """Observe, pay and judge what ``worlds`` worlds (all) from ``first`` on have driven.

        Raises ValueError for worlds that are not there.
        """
        count = self.worlds if worlds is None else worlds
        self._check_worlds(first, count)
        judge_worlds(self._packed, first, count, False)
        if self.terms is not None:
            self.terms.pay(self, first, count)

    def begin(self, world: int, state: State) -> None:
        """Begin the episode that ``world`` and its filter have been reset for: sense, observe.

        ``state`` (4,) is what the filter's replicas draw from.
        """
        tracks = self.tracks
        draw_anew(self.replicas, world, state)
        take_up(
            self.replicas, world, belief_of(self.beliefs, world), self.world.robots.odometry[world]
        )
        tracks.sums[world] = 0.0
        tracks.distance[world] = 0.0
        tracks.steps[world] = 0
        tracks.outcome[world] = RUNNING
        if self.terms is not None:
            self.terms.begin(world)
        drive_worlds(self._packed, world, self._still, 0)
        self.observe(world)

    def observe(self, world: int) -> None:
        """Rewrite the observation of ``world``; nothing is paid."""
        self._check_worlds(world, 1)
        judge_worlds(self._packed, world, 1, True)

    def know(self, out: NDArray[np.float32], first: int = 0) -> None:
        """Write the privileged floats of n worlds from ``first`` on to ``out`` (n, len(NAMES)).

        They are of the moment that was last observed. Raises ValueError for worlds that are not
        there, or an array of another width or kind.
        """
        if out.dtype != np.float32 or out.ndim != 2 or out.shape[1] != len(NAMES):
            raise ValueError(f"privileged floats need a float32 (n, {len(NAMES)}) to be written to")
        self._check_worlds(first, len(out))
        know_worlds(self._packed, first, out)

    def _check_worlds(self, first: int, count: int) -> None:
        if not 0 <= first <= first + count <= self.worlds:
            raise ValueError(f"{count} worlds from {first} on are not among {self.worlds}")


def _check_room(observation: Observation, worlds: int, config: RunConfig) -> None:
    """Raise ValueError unless ``observation`` has the arrays of ``worlds`` worlds: kernels write
    there without looking.
    """
    wanted = Observation.zeros_for(worlds, config)
    for name, expected in vars(wanted).items():
        given = getattr(observation, name)
        if given.shape != expected.shape or given.dtype != expected.dtype:
            raise ValueError(
                f"observation.{name} must be {expected.dtype} {expected.shape}, "
                f"not {given.dtype} {given.shape}"
            )


def _heard(config: RunConfig) -> NDArray[np.bool_]:
    """(ticks per control step,) whether the filter updates after the tick."""
    ticks = np.arange(1, config.world.ticks_per_step + 1)
    chosen = config.localization.update_ticks
    return np.ones(len(ticks), bool) if chosen is None else np.isin(ticks, chosen)


def _task(config: RunConfig) -> Task:
    task = config.task
    return Task(
        ticks=int(config.world.ticks_per_step),
        steps_limit=config.steps_limit,
        scan_scale=SCAN_COUNTS / float(config.world.laser.range_max),
        map_extent=float(task.map_extent),
        variance_limit=float(task.variance_limit),
        limits=(
            float(task.lost_distance),
            float(task.lost_angle),
            float(task.arrive_distance),
            pose_error_limit(task.reward),
        ),
        weights=reward_weights(task.reward),
        judges_report=task.judged_moment == "report",
    )
