"""Second tries: a world whose episode failed goes back some steps and plays on from there.

Failures are rare, so most of what is learned of them comes from a few states. A world that goes
back to shortly before one, and meets other noise and other actions, shows what might have been
done (Schulman et al. 2015, "Trust region policy optimization", calls it the vine). Every reward is
still that of the task: only where episodes begin has changed, and so where the policy improves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RetryConfig
from lndrl.navigation.navigation import Navigation
from lndrl.navigation.observation import Observation
from lndrl.navigation.track import TIMEOUT
from lndrl.navigation.training.replicas import arrays_of
from lndrl.randomness import Stream, episode_states, uniform

_FAILED = ("collided", "lost")


class _Moment(NamedTuple):
    """All that is one world's own, as it was after ``steps`` control steps."""

    steps: int
    rows: list[NDArray[np.generic]]
    observation: Observation


class Retries:
    """What ``worlds`` were some steps ago, and which of them are playing a second try.

    Draws derive from (seed, world id, episode), as all of a world's do; every try has an episode
    number of its own.
    """

    def __init__(self, settings: RetryConfig, worlds: list[Navigation]) -> None:
        self._settings = settings
        self._worlds = worlds
        self._moments: list[list[_Moment]] = [[] for _ in worlds]
        self._tries = [0] * len(worlds)
        self._until = [0] * len(worlds)

    def trying(self, i: int) -> bool:
        """Whether what world ``i`` plays is a second try, not an episode from its start."""
        return self._tries[i] > 0

    def remember(self) -> None:
        """Keep what the worlds are now, every ``settings.every`` control steps of each."""
        every, most = self._settings.every, self._settings.back[1]
        for i, world in enumerate(self._worlds):
            steps = world.steps
            if steps % every or self.trying(i):
                continue
            kept = [m for m in self._moments[i] if m.steps >= steps - most]
            rows = [row.copy() for row in _rows(world)]
            self._moments[i] = [*kept, _Moment(steps, rows, world.observation.copy())]

    def cut(self) -> None:
        """Cut tries off that have outlived the failure by ``settings.past`` control steps."""
        for i, world in enumerate(self._worlds):
            if self.trying(i) and world.steps >= self._until[i] and not world.outcome:
                world.track.outcome[0] = TIMEOUT

    def go_back(self, i: int) -> bool:
        """Take world ``i``, which has ended, back for another try; False: it shall begin anew."""
        world, settings = self._worlds[i], self._settings
        if not self.trying(i):
            least, most = settings.back
            near = [m for m in self._moments[i] if least <= world.steps - m.steps <= most]
            self._moments[i] = near if world.outcome in _FAILED else []
            self._until[i] = world.steps + settings.past
        if not self._moments[i] or self._tries[i] >= settings.most:
            self._moments[i], self._tries[i] = [], 0
            return False
        states = episode_states(world.seed, world.world_id, world.episode + 1)
        moment = self._moments[i][int(uniform(states[Stream.LAYOUT]) * len(self._moments[i]))]
        for row, then in zip(_rows(world), moment.rows, strict=True):
            row[...] = then
        world.observation.put(Ellipsis, moment.observation)
        world.go_on(states)
        self._tries[i] += 1
        return True


def _rows(world: Navigation) -> list[NDArray[np.generic]]:
    """Views of every array that is this world's own."""
    batch, i = world.batch, world.index
    parts = (
        batch.world.robots, batch.world.people, batch.beliefs, batch.tracks,
        arrays_of(batch.replicas),
    )  # fmt: skip
    return [array[i] for part in parts for array in part]
