"""Driving test episodes with a planner: several worlds side by side, each exactly one episode."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.navigation import EpisodeRecord, Navigation, Observation, build_surroundings
from lndrl.navigation.terms import without_terms
from lndrl.planners import MapPlanner, Planner, PlannerSource

TEST_WORLD = 4_000_000_000
"""World id of test episode 0, far above those of actors: no test episode is ever trained on."""


def world_of_test(episode: int) -> int:
    """World id of a test episode; every one has a world of its own, whoever drives in it."""
    return TEST_WORLD + episode


class EpisodeRunner:
    """A place and a planner, built once, for any number of test episodes.

    Test episode k is drawn from (``config.seed``, TEST_WORLD + k) alone: every planner faces the
    same starts, goals and crowds. Rewards are the compiled parts alone, whatever ``config`` adds in
    training. Raises UserError for an impossible scenario and for weights that do not fit
    ``config``.
    """

    def __init__(self, source: PlannerSource, config: RunConfig, greedy: bool = False) -> None:
        self.config = config = without_terms(config)
        self.planner = source.build(config, greedy)
        self._place, self._field = build_surroundings(config)

    def __call__(
        self, episodes: Sequence[int], watch: Callable[[Navigation], None] | None = None
    ) -> Iterator[EpisodeRecord]:
        """Run ``episodes`` side by side; yields the record of each when it ends.

        ``watch`` is called for every world at its start and after each of its control steps.
        """
        observation = Observation.zeros_for(len(episodes), self.config)
        worlds = [
            Navigation(
                self._place,
                self._field,
                self.config,
                world_of_test(k),
                observation.take((row, Ellipsis)),
            )
            for row, k in enumerate(episodes)
        ]
        for world in worlds:
            world.reset(0)
            if watch is not None:
                watch(world)
        self.planner.reset(self.config.seed, [world.world_id for world in worlds])
        show_map(self.planner, worlds)
        running = np.arange(len(worlds))
        while len(running):
            tell_poses(self.planner, worlds, running)
            velocities = self.planner.act(observation.take(running), running)
            for row, (v, w) in zip(running, velocities.tolist(), strict=True):
                record = worlds[row].step(v, w).record
                if watch is not None:
                    watch(worlds[row])
                if record is not None:
                    yield record
            running = running[[not worlds[row].outcome for row in running]]


def show_map(planner: Planner, worlds: Sequence[Navigation]) -> None:
    """Show a planner that knows the map the places of ``worlds``, which have been reset."""
    if isinstance(planner, MapPlanner):
        planner.enter([world.place for world in worlds])


def tell_poses(planner: Planner, worlds: Sequence[Navigation], rows: NDArray[np.int64]) -> None:
    """Tell such a planner where in it the robots at ``rows`` of ``worlds`` believe to be."""
    if isinstance(planner, MapPlanner):
        planner.hear(np.stack([worlds[row].pose_heard for row in rows]), rows)
