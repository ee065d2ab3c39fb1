"""States that nobody met but might have, with what the teacher says of them.

The teacher can be asked about any observation. So what a policy learns from need not be met again
and again until it is known by heart: goal, people and belief are moved a little each time it is
drawn, and labelled anew.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.navigation import Observation
from lndrl.navigation.trajectory import above_cheapest

_GOAL_TURN = 0.8  # rad, deviation
_GOAL_STRETCH = 0.3  # deviation of the distance's logarithm
_PERSON_SHIFT = 0.15  # m: the legs that the scan has seen stay where they are
_PERSON_TURN = 0.5  # rad
_PERSON_STRETCH = 0.3  # of the speed's logarithm
_BELIEF_STRETCH = 0.7  # of the variances' logarithm
_NEWCOMER = 0.3  # chance of one person more
_NEWCOMER_NEAREST = 0.6  # m
_FASTEST = 1.2  # m/s of a newcomer


class Variations:
    """Varies observations and labels them anew, by the teacher of ``config``.

    The teacher must go by the observation alone (``RunConfig.teacher_misfit``). Raises UserError
    for one that cannot be built.
    """

    def __init__(self, config: RunConfig) -> None:
        from lndrl.planners import teacher_of  # brings what few runs need

        self._teacher = teacher_of(config)
        self._teacher.reset(config.seed, [0])
        self._half = 0.5 * config.task.map_extent
        self._limit = config.task.variance_limit

    def __call__(self, seen: Observation, rng: np.random.Generator) -> NDArray[np.float16]:
        """Vary ``seen`` (B,) in place; returns the costs above the cheapest, (B, actions)."""
        self._vary_goal(seen, rng)
        self._vary_people(seen, rng)
        costs = self._teacher.costs(seen, np.zeros(len(seen), np.int64))
        return above_cheapest(costs)

    def _vary_goal(self, seen: Observation, rng: np.random.Generator) -> None:
        turn = _GOAL_TURN * rng.standard_normal(len(seen))
        stretch = np.exp(_GOAL_STRETCH * rng.standard_normal(len(seen)))
        x, y = seen.goal[:, 0].copy(), seen.goal[:, 1].copy()
        cosine, sine = stretch * np.cos(turn), stretch * np.sin(turn)
        seen.goal[:, 0] = cosine * x - sine * y
        seen.goal[:, 1] = sine * x + cosine * y
        wider = np.exp(_BELIEF_STRETCH * rng.standard_normal((len(seen), 1)))
        seen.goal[:, 3:] = np.minimum(seen.goal[:, 3:] * wider, self._limit)

    def _vary_people(self, seen: Observation, rng: np.random.Generator) -> None:
        people, count = seen.pedestrians, seen.pedestrian_count
        most = people.shape[1]
        there = np.arange(most) < count[:, None]
        people[..., :2] += _PERSON_SHIFT * rng.standard_normal(people[..., :2].shape)
        turn = _PERSON_TURN * rng.standard_normal(there.shape)
        stretch = np.exp(_PERSON_STRETCH * rng.standard_normal(there.shape))
        vx, vy = people[..., 2].copy(), people[..., 3].copy()
        people[..., 2] = stretch * (np.cos(turn) * vx - np.sin(turn) * vy)
        people[..., 3] = stretch * (np.sin(turn) * vx + np.cos(turn) * vy)
        comes = (rng.random(len(seen)) < _NEWCOMER) & (count < most)
        rows, place = np.flatnonzero(comes), count[comes]
        people[rows, place] = self._newcomers(len(rows), rng)
        there[rows, place] = True
        there &= (np.abs(people[..., :2]) <= self._half).all(axis=2)
        # Near to far, as they are drawn; whoever has left the map comes last and is forgotten.
        distance = np.where(there, np.hypot(people[..., 0], people[..., 1]), np.inf)
        order = np.argsort(distance, axis=1, kind="stable")
        people[:] = np.take_along_axis(people, order[..., None], axis=1)
        count[:] = there.sum(axis=1)
        people[np.arange(most) >= count[:, None]] = 0.0

    def _newcomers(self, number: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """(number, 4) x, y (m), vx, vy (m/s) of people somewhere around the robot."""
        bearing, heading = rng.uniform(-np.pi, np.pi, (2, number))
        distance = rng.uniform(min(_NEWCOMER_NEAREST, self._half), self._half, number)
        speed = rng.uniform(0.0, _FASTEST, number)
        return np.stack(
            (
                distance * np.cos(bearing),
                distance * np.sin(bearing),
                speed * np.cos(heading),
                speed * np.sin(heading),
            ),
            axis=1,
        )
