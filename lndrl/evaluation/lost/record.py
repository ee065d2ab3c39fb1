"""What robot, crowd and filter did in every control step of an episode, as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.kernels import expect
from lndrl.localization import AMCL
from lndrl.localization.clusters import two_heaviest
from lndrl.localization.update import fill_bins
from lndrl.navigation import EpisodeRecord, Navigation

Floats = NDArray[np.float64]

AHEAD = 6.0
"""m; people so near, within the laser's field of view, are ahead: they hide the place."""

COLUMNS = (
    "x",
    "y",
    "yaw",
    "x_estimated",
    "y_estimated",
    "yaw_estimated",
    "particles",
    "slow_average",
    "fast_average",
    "first_cluster",
    "second_cluster",
    "echoes",
    "people",
)
"""What is known of every moment: true and estimated pose (m, rad), the filter's count, its two
averages, the shares of the weight in its two heaviest clusters, the share of beams with an echo,
and the number of people ahead."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One episode of T control steps.

    ``moments`` (T + 1, columns) has the start and the end of every step, see ``COLUMNS``. The
    estimate is the filter's own, as it was made: no ``localization.delay`` in it.
    """

    scenario: str
    episode: int
    outcome: str
    moments: Floats

    @property
    def steps(self) -> int:
        """Control steps."""
        return len(self.moments) - 1

    @property
    def is_lost(self) -> bool:
        """Whether that is how it ended."""
        return self.outcome == "lost"

    def column(self, name: str) -> Floats:
        """One of ``COLUMNS`` over time, (T + 1,)."""
        column: Floats = self.moments[:, COLUMNS.index(name)]
        return column


class Recorder:
    """Watches the worlds of one block of episodes; an ``EpisodeRunner`` takes it as ``watch``.

    Looks and changes nothing: an episode ends as it does unwatched. Memory for the longest
    episodes is taken once, because Python between two steps is the price of looking.
    """

    def __init__(self, episodes: Sequence[int], config: RunConfig) -> None:
        expect(fill_bins, two_heaviest)
        self._scenario = config.scenario.name
        self._episodes = list(episodes)
        self._range_max = float(config.world.laser.range_max)
        self._half_view = 0.5 * float(config.world.laser.field_of_view)
        self._moments = np.zeros((len(self._episodes), config.steps_limit + 1, len(COLUMNS)))
        self._rows: dict[int, int] = {}  # world to row, in the order in which worlds start

    def __call__(self, world: Navigation) -> None:
        """Note one moment of ``world``."""
        row = self._rows.setdefault(world.world_id, len(self._rows))
        localization, true = world.localization, world.world.pose_true
        assert isinstance(localization, AMCL)
        moment = self._moments[row, world.steps]
        moment[:3] = true
        moment[3:6] = localization.pose_estimated
        moment[6] = localization.count
        moment[7:9] = localization.averages
        moment[9:11] = localization.cluster_masses()
        moment[11] = np.count_nonzero(world.scan < self._range_max) / world.scan.size
        moment[12] = people_ahead(true, world.world.pedestrian_position, self._half_view)

    def trace(self, record: EpisodeRecord) -> Trace:
        """The episode that has ended with ``record``."""
        row = self._rows[record.world]
        moments = self._moments[row, : record.steps + 1].copy()
        return Trace(self._scenario, self._episodes[row], record.outcome, moments)


def people_ahead(pose: Floats, people: Floats, half_view: float) -> int:
    """How many of ``people`` (P, 2) stand within ``AHEAD`` m and ``half_view`` rad of where a
    robot at ``pose`` (3,) looks.
    """
    x, y = (people - pose[:2]).T
    bearing = np.arctan2(y, x) - pose[2]
    # The cosine of a difference needs no wrapping.
    in_view = np.cos(bearing) >= np.cos(half_view) - 1e-12
    return int(np.count_nonzero(in_view & (np.hypot(x, y) <= AHEAD)))
