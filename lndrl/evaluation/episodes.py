"""Driving test episodes with a planner: several worlds side by side, each exactly one episode."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.localization import LikelihoodMap
from lndrl.navigation import EpisodeRecord, Navigation, Observation, build_surroundings
from lndrl.navigation.batch import NavigationBatch
from lndrl.navigation.families import Family
from lndrl.navigation.terms import as_settled, as_tested
from lndrl.planners import MapPlanner, Planner, PlannerSource
from lndrl.world import Place

Surroundings = tuple[Place, LikelihoodMap]


class EpisodeRunner:
    """A place and a planner, built once, for any number of test episodes.

    Test episode k is drawn from (``config.seed``, ``family.world(k)``) alone: every planner faces
    the same starts, goals and crowds. Rewards are the compiled parts alone, whatever ``config``
    adds in training, unless they are ``as_trained``: with its limit of the pose part and its terms.
    ``surroundings`` are those of ``config`` where they are built already. Raises UserError for an
    impossible scenario, for weights that do not fit ``config``, and for terms that are not trusted.
    """

    def __init__(
        self,
        source: PlannerSource,
        config: RunConfig,
        greedy: bool = False,
        family: Family = Family.VALIDATION,
        surroundings: Surroundings | None = None,
        as_trained: bool = False,
    ) -> None:
        self.config = config = as_settled(config) if as_trained else as_tested(config)
        self.family = family
        self.planner = source.build(config, greedy)
        self._place, self._field = surroundings or build_surroundings(config)
        self._team: Team | None = None

    def __call__(
        self, episodes: Sequence[int], watch: Callable[[Navigation], None] | None = None
    ) -> Iterator[EpisodeRecord]:
        """Run ``episodes`` side by side; yields the record of each when it ends.

        ``watch`` is called for every world at its start and after each of its control steps. A call
        ends the one before: worlds and planner are the same. Raises UserError for an episode that
        the family has not.
        """
        ids = [self.family.world(k) for k in episodes]
        team = self._team_of(len(ids))
        worlds = team.begin(ids)
        if watch is not None:
            for world in worlds:
                watch(world)
        self.planner.reset(self.config.seed, ids)
        show_map(self.planner, worlds)
        running = np.arange(len(worlds))
        while len(running):
            tell_poses(self.planner, worlds, running)
            velocities = self.planner.act(team.observation.take(running), running)
            team.step(running, velocities)
            rows = running.tolist()
            if watch is not None:
                for row in rows:
                    watch(worlds[row])
            ended = np.array([worlds[row].outcome != "" for row in rows])
            yield from [worlds[row].record() for row in running[ended]]
            running = running[~ended]

    def _team_of(self, size: int) -> Team:
        """Worlds for ``size`` episodes: those of the last call where they are enough."""
        if self._team is None or len(self._team.worlds) < size:
            self._team = Team(self._place, self._field, self.config, size)
        return self._team


class Team:
    """``size`` worlds of one place, to be used again: their memory takes longer than an episode's
    start. ``observation`` (size,) is rewritten in place.
    """

    def __init__(self, place: Place, field: LikelihoodMap, config: RunConfig, size: int) -> None:
        self.observation = Observation.zeros_for(size, config)
        # Where there are many layouts every world has a place, and so memory, of its own.
        self._batch: NavigationBatch | None = None
        if config.scenario.layouts is None:
            self._batch = NavigationBatch(place, field, config, size, self.observation)
        rows = (self.observation.take((row, Ellipsis)) for row in range(size))
        self.worlds = [
            Navigation(place, field, config, 0, shown, self._batch, row)
            for row, shown in enumerate(rows)
        ]

    def begin(self, ids: Sequence[int]) -> list[Navigation]:
        """Start episode 0 of the worlds ``ids``, which are the first rows from now on."""
        worlds = self.worlds[: len(ids)]
        for world, world_id in zip(worlds, ids, strict=True):
            world.world_id = world_id
            world.reset(0)
        return worlds

    def step(self, rows: NDArray[np.int64], velocities: NDArray[np.float64]) -> None:
        """One control step of ``rows`` (n,), ascending, with ``velocities`` (n, 2) m/s, rad/s."""
        commands = np.ascontiguousarray(velocities, dtype=np.float64)
        if self._batch is None:
            for row, (v, w) in zip(rows.tolist(), commands.tolist(), strict=True):
                self.worlds[row].step(v, w)
            return
        # Worlds side by side in memory go in one compiled call; who has ended leaves a gap.
        for run in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > 1) + 1):
            first = int(rows[run[0]])
            self._batch.drive(commands[run[0] : run[-1] + 1], first)
            self._batch.judge(first, len(run))


def show_map(planner: Planner, worlds: Sequence[Navigation]) -> None:
    """Show a planner that knows the map the places of ``worlds``, which have been reset."""
    if isinstance(planner, MapPlanner):
        planner.enter([world.place for world in worlds])


def tell_poses(planner: Planner, worlds: Sequence[Navigation], rows: NDArray[np.int64]) -> None:
    """Tell such a planner where in it the robots at ``rows`` of ``worlds`` believe to be."""
    if isinstance(planner, MapPlanner):
        planner.hear(np.stack([worlds[row].pose_heard for row in rows]), rows)
