"""The careful planner with a map: it also knows where, and looking where, a scan tells much.

Beside what the policy sees it hears the estimated pose and knows the place. From the localizability
field of the place (``lndrl.maps.localizability``) it has how well a scan will pin the pose down
wherever its rollouts end, and how much dearer the rest of the way is for leading through places
where scans tell little. All of it is ours (docs/planners.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.kernels import kernel
from lndrl.localization.localizability import localizability_field
from lndrl.maps.localizability import LocalizabilityField, deviation_at
from lndrl.models import NonNegative, Positive
from lndrl.navigation import Observation
from lndrl.planners.careful import CarefulConfig, CarefulPlanner
from lndrl.planners.ways import WayPrices, Ways
from lndrl.world import Place

Floats = NDArray[np.float64]


class CarefulMapConfig(CarefulConfig):
    """Parameters of the planner (ours): those of ``careful``, and what the map tells."""

    sure: NonNegative = Field(
        0.15, description="m of deviation by one scan up to which a place costs nothing"
    )
    unsure: Positive = Field(1.5, description="m of deviation from which it costs no more")
    look_weight: NonNegative = Field(
        5.0, description="per m of that deviation where the first action ends and the second does"
    )
    way_weight: NonNegative = Field(
        8.0, description="m that a metre of the way counts more, per m of that deviation"
    )
    way_room: Positive = Field(0.3, description="m to walls that ways keep")

    @model_validator(mode="after")
    def _order(self) -> CarefulMapConfig:
        if not self.sure < self.unsure:
            raise ValueError(f"sure must be below unsure ({self.unsure:g}), not {self.sure:g}")
        return self


class CarefulMapPlanner(CarefulPlanner):
    """``careful``, whose pairs of actions also cost what the map says of where they end.

    A ``MapPlanner``. ``field`` is a localizability field to use instead of the one that is built
    for each place; it must be of the place. Raises UserError without variances to be careful with
    (``localization.kind`` perfect), for a field of another map, and where nobody has told it the
    place and the pose.
    """

    name = "careful+map"

    def __init__(
        self,
        config: RunConfig,
        parameters: CarefulMapConfig | None = None,
        field: LocalizabilityField | None = None,
    ) -> None:
        self._map = parameters or CarefulMapConfig()
        super().__init__(config, self._map)
        self._config = config
        self._given = field
        self._known: dict[Place, tuple[LocalizabilityField, Ways, Ways]] = {}
        self._places: list[Place] = []
        self._more: list[Floats | None] = []
        self._poses, self._rows = np.zeros((0, 3)), np.zeros(0, np.int64)
        self._turning_alone = self._rollouts
        first = self.parameters.first_horizon
        self._firsts = np.array([moved(np.zeros(3), v, w, first) for v, w in self._actions])

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """See ``Planner.reset``."""
        super().reset(seed, worlds)
        self._places, self._more = [], [None] * len(worlds)
        self._rows = np.zeros(0, np.int64)

    def enter(self, places: Sequence[Place]) -> None:
        """See ``MapPlanner.enter``."""
        self._places = list(places)
        # Those of former episodes are let go: a random scenario has a place for each.
        each = dict.fromkeys(places)
        self._known = {place: self._known.get(place) or self._study(place) for place in each}

    def _study(self, place: Place) -> tuple[LocalizabilityField, Ways, Ways]:
        """The field of ``place``, its ways as scans make them, and as lengths alone do."""
        p, world = self._map, self._config.world
        field = self._given
        if field is None:
            field = localizability_field(
                place.grid, place.cells, world.laser, self._config.localization
            )
        field.check(place.grid, self.name)
        doubtful = WayPrices(p.way_weight, p.sure, p.unsure, p.way_room)
        return (
            field,
            Ways.build(place, field, doubtful),
            Ways.build(place, field, doubtful._replace(doubt=0.0)),
        )

    def hear(self, poses: Floats, rows: NDArray[np.int64]) -> None:
        """See ``MapPlanner.hear``."""
        self._poses, self._rows = np.array(poses, np.float64), np.array(rows)

    def _decide(
        self,
        observation: Observation,
        every: bool,
        goals: NDArray[np.floating] | None = None,
        turning: Floats | None = None,
        start: Floats | None = None,
        rows: NDArray[np.int64] | None = None,
    ) -> Floats:
        assert goals is not None and turning is not None and start is not None  # careful's are
        if len(self._rows) != len(observation) or not self._places:
            raise UserError(
                "careful+map: needs the place and the pose that the robot hears; drive it with "
                "lndrl evaluate, or call enter after reset and hear before act"
            )
        out = np.empty((len(observation), len(self._actions)))
        for i, row in enumerate(self._rows):
            only = slice(i, i + 1)
            price = self._map_price(i, int(row), observation.goal[i, :2])
            price = self._turning_alone.price + price / max(float(turning[i]), 1e-9)
            self._rollouts = self._turning_alone._replace(price=price)
            seen = observation.take(only)
            mine = None if rows is None else rows[only]
            out[only] = super()._decide(seen, every, goals[only], turning[only], start[only], mine)
        self._rollouts = self._turning_alone
        return out

    def _map_price(self, i: int, row: int, goal: NDArray[np.floating]) -> Floats:
        """What each pair of actions costs (A, A) for where in the map it ends."""
        field, doubtful, plain = self._known[self._places[row]]
        pose = self._poses[i]
        more = self._more[row]
        if more is None:
            there = _in_map(pose, goal.astype(np.float64))
            more = self._more[row] = doubtful.left(there) - plain.left(there)
        for v, w in self._commands[row, 1:]:  # since the filter said so
            pose = moved(pose, v, w, self._period)
        p = self._map
        price = np.zeros_like(self._turning_alone.price)
        map_prices(
            field.deviation, more, 1.0 / field.spacing, field.sensor.farthest, pose, self._firsts,
            self._turning_alone.end, p.sure, p.unsure, p.look_weight, p.goal_weight, price,
        )  # fmt: skip
        return price


def moved(pose: Floats, v: float, w: float, seconds: float) -> Floats:
    """``pose`` (3,) after so many ``seconds`` of ``v`` m/s and ``w`` rad/s, exactly."""
    half = 0.5 * w * seconds
    chord = v * seconds * np.sinc(half / np.pi)
    along = pose[2] + half
    return pose + np.array([chord * np.cos(along), chord * np.sin(along), 2.0 * half])


def _in_map(pose: Floats, point: Floats) -> Floats:
    """Where in the map ``point`` (2,) of the frame of a robot at ``pose`` (3,) is."""
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    x, y = point
    return pose[:2] + np.array([cosine * x - sine * y, sine * x + cosine * y])


@kernel()
def map_prices(
    deviation, more, inverse_spacing, farthest, pose, firsts, ends, sure, unsure, look, way, out
):
    """Add to ``out`` (A, A) what pairs cost for where they end on the map of a field.

    ``deviation`` (rows, columns, headings) m, ``farthest`` off the map; ``more`` (rows, columns):
    m by which what is left of the way from a place is dearer for what scans tell, at ``way`` per m.
    ``pose`` (3,) of the robot in the field's frame; ``firsts`` (A, 3) and ``ends`` (A, A, 3) are
    poses in the robot's where the first action and the pair end: ``look`` per m of deviation above
    ``sure`` (m) up to ``unsure`` (m), half for either.
    """
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    for i in range(min(out.shape[0], firsts.shape[0], ends.shape[0])):
        x = pose[0] + cosine * firsts[i, 0] - sine * firsts[i, 1]
        y = pose[1] + sine * firsts[i, 0] + cosine * firsts[i, 1]
        yaw = pose[2] + firsts[i, 2]
        here = deviation_at(deviation, inverse_spacing, 0.0, 0.0, farthest, x, y, yaw)
        here = min(max(here, sure), unsure) - sure
        for j in range(min(out.shape[1], ends.shape[1])):
            x = pose[0] + cosine * ends[i, j, 0] - sine * ends[i, j, 1]
            y = pose[1] + sine * ends[i, j, 0] + cosine * ends[i, j, 1]
            yaw = pose[2] + ends[i, j, 2]
            there = deviation_at(deviation, inverse_spacing, 0.0, 0.0, farthest, x, y, yaw)
            there = min(max(there, sure), unsure) - sure
            out[i, j] += 0.5 * look * (here + there) + way * _between(more, inverse_spacing, x, y)


@kernel()
def _between(values, inverse_spacing, x, y):
    """``values`` (rows, columns) at ``x``, ``y`` m, between the middles of places; at the edge what
    is there, beyond it too; 0 for NaN.
    """
    rows, columns = values.shape
    if not (abs(x) < 1e6 and abs(y) < 1e6) or rows == 0 or columns == 0:
        return 0.0
    u = min(max(x * inverse_spacing - 0.5, 0.0), columns - 1.0)
    v = min(max(y * inverse_spacing - 0.5, 0.0), rows - 1.0)
    c, r = int(u), int(v)
    c1, r1 = min(c + 1, columns - 1), min(r + 1, rows - 1)
    a, b = u - c, v - r
    low = values[r, c] * (1.0 - a) + values[r, c1] * a
    high = values[r1, c] * (1.0 - a) + values[r1, c1] * a
    return low * (1.0 - b) + high * b
