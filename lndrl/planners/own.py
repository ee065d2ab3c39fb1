"""A planner that is a class of a user's own, called and watched."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.extensions import PLANNER, PartSettings, calling, find, make
from lndrl.navigation import Observation
from lndrl.planners.interface import MapPlanner, Planner

if TYPE_CHECKING:
    from lndrl.world import Place

_SLACK = 1e-9  # rounding


class OwnPlanner:
    """The planner that ``name`` stands for, under ``config``.

    Its class is called with (config) and its settings; one that has ``enter`` and ``hear`` is told
    the places and poses (``MapPlanner``). Raises UserError where it is not trusted, not there,
    fails, or gives velocities that the robot does not have.
    """

    def __init__(
        self, name: str, config: RunConfig, settings: PartSettings, builtin: Collection[str] = ()
    ) -> None:
        self.name = name
        found = find(PLANNER, name, builtin)
        assert found is not None  # a built-in planner is none of a user's own
        self._planner: Planner = make(PLANNER, found, name, config, **settings)
        # Not isinstance(MapPlanner): who asks for the map need not have a name.
        asks = all(callable(getattr(self._planner, each, None)) for each in ("enter", "hear"))
        self._knower = cast(MapPlanner, self._planner) if asks else None
        self._limits = tuple(
            (min(speeds), max(speeds))
            for speeds in (config.task.linear_velocities, config.task.angular_velocities)
        )

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """See ``Planner.reset``."""
        with calling(PLANNER, self.name):
            self._planner.reset(seed, worlds)

    def enter(self, places: Sequence[Place]) -> None:
        """See ``MapPlanner.enter``."""
        if self._knower is not None:
            with calling(PLANNER, self.name):
                self._knower.enter(places)

    def hear(self, poses: NDArray[np.float64], rows: NDArray[np.int64]) -> None:
        """See ``MapPlanner.hear``."""
        if self._knower is not None:
            with calling(PLANNER, self.name):
                self._knower.hear(poses, rows)

    def act(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """See ``Planner.act``."""
        with calling(PLANNER, self.name):
            velocities = np.asarray(self._planner.act(observation, rows), dtype=np.float64)
        if velocities.shape != (len(rows), 2):
            raise UserError(
                f"planner {self.name}: must answer {len(rows)} observations with v and w for each, "
                f"({len(rows)}, 2), not {velocities.shape}"
            )
        for column, what, (least, most) in zip((0, 1), ("v", "w"), self._limits, strict=True):
            asked = velocities[:, column]
            wrong = asked[~((asked >= least - _SLACK) & (asked <= most + _SLACK))]
            if len(wrong):
                raise UserError(
                    f"planner {self.name}: asks for {what} = {wrong[0]:g}; "
                    f"this robot has {least:g} to {most:g} (task)"
                )
        return velocities
