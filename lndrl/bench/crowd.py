"""``lndrl bench crowd``: one tick of 22 pedestrians, with targets, gait and legs."""

from __future__ import annotations

import statistics
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.bench.report import REPETITIONS
from lndrl.config import CrowdConfig
from lndrl.kernels import kernel
from lndrl.maps import distance_field
from lndrl.maps.grid import polygon_mask
from lndrl.world.pedestrians import ORCA, SFM, Crowd, advance_people, walls_for
from lndrl.world.people import Surroundings

PEOPLE = 22
TICK = 0.1  # s
SIZE = (33.0, 20.0)  # m
RECTANGLES = 25
WIDE: dict[str, Any] = {"orca_neighbor_distance": 5.0, "orca_radius": 0.3}
"""Settings with which ORCA people see each other before they touch."""

_GOALS = 64  # waypoints of a route: nobody arrives for good
_RESOLUTION = 0.05
_WARM_UP = 200  # ticks
_BATCH = 50  # ticks between two looks at the clock; short, so that medians skip interruptions
_ASIDE = np.array([-100.0, -100.0, 0.0])

Floats = NDArray[np.float64]


def rectangles(seed: int = 3) -> list[Floats]:
    """25 solid rectangles (4, 2) of 0.25 to 1.5 m, counter-clockwise, that do not overlap."""
    rng = np.random.default_rng(seed)
    boxes: list[Floats] = []
    while len(boxes) < RECTANGLES:
        size = rng.uniform(0.25, 1.5, 2)
        low = rng.uniform(1.0, np.array(SIZE) - 1.0 - size)
        box = np.concatenate([low, low + size])
        if all((box[2:] + 0.2 < b[:2]).any() or (box[:2] - 0.2 > b[2:]).any() for b in boxes):
            boxes.append(box)
    return [
        np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], dtype=np.float64)
        for x0, y0, x1, y1 in boxes
    ]


def random_goals(people: int, goals: int, seed: int = 1) -> Floats:
    """Uniform points of the scene, ``(people, goals, 2)`` m."""
    rng = np.random.default_rng(seed)
    return rng.uniform(1.0, np.array(SIZE) - 1.0, (people, goals, 2))


def open_field(solids: list[Floats]) -> NDArray[np.float32]:
    """Distance field of the scene with an outer wall and ``solids``."""
    columns, rows = (round(side / _RESOLUTION) for side in SIZE)
    x = (np.arange(columns, dtype=np.float64) + 0.5) * _RESOLUTION
    y = (np.arange(rows, dtype=np.float64) + 0.5) * _RESOLUTION
    occupied = np.ones((rows, columns), dtype=np.bool_)
    occupied[2:-2, 2:-2] = False
    for solid in solids:
        occupied |= polygon_mask([(float(a), float(b)) for a, b in solid], x, y)
    return distance_field(occupied, _RESOLUTION)


def build_crowd(model: int, walls: bool = False, **settings: Any) -> tuple[Crowd, Surroundings]:
    """22 people who walk from random goal to random goal, and what they walk in."""
    config = CrowdConfig(see_robot=False, orca_walls=walls, **settings)
    solids = rectangles() if walls else []
    outer = np.array([(0.1, 0.1), (0.1, 19.9), (32.9, 19.9), (32.9, 0.1)])
    crowd = Crowd(PEOPLE, _GOALS, config, TICK, walls_for([outer, *solids], config))
    crowd.count = PEOPLE
    crowd.route[:] = random_goals(PEOPLE, _GOALS)
    crowd.route_length[:] = _GOALS
    crowd.position[:PEOPLE] = crowd.route[:, 0]
    crowd.target[:] = 1
    crowd.shuttle[:] = True
    crowd.model[:] = model
    return crowd, Surroundings(open_field(solids), 1.0 / _RESOLUTION, crowd.walls)


def measure(seconds: float) -> dict[str, Any]:
    """Microseconds of one tick of 22 people on 33 x 20 m, targets, gait and legs included.

    Called from a compiled loop, as worlds do; ``..._from_python`` by ``Crowd.advance``.
    ``with_walls``: 25 rectangles and the outer wall as ORCA's obstacles; ``wide``: ORCA with
    neighbours within 5 m and a radius of 0.3 m.
    """
    each = seconds / 5.0
    crowd, surroundings = build_crowd(ORCA)
    return {
        "tick_microseconds": tick_microseconds(crowd, surroundings, each),
        "tick_microseconds_from_python": python_microseconds(crowd, surroundings, each),
        "tick_microseconds_with_walls": tick_microseconds(*build_crowd(ORCA, walls=True), each),
        "tick_microseconds_social_force": tick_microseconds(*build_crowd(SFM), each),
        "tick_microseconds_wide": tick_microseconds(*build_crowd(ORCA, **WIDE), each),
    }


def tick_microseconds(crowd: Crowd, surroundings: Surroundings, seconds: float) -> float:
    """Median over repetitions of a tick in a compiled loop."""
    arguments = (
        crowd.people,
        _ASIDE,
        np.zeros(2),
        surroundings,
        crowd.parameters,
        crowd.scratch,
    )
    _ticks(_WARM_UP, *arguments)
    return _median(lambda: _ticks(_BATCH, *arguments), seconds)


def python_microseconds(crowd: Crowd, surroundings: Surroundings, seconds: float) -> float:
    """Median over repetitions of ``Crowd.advance``."""
    command = np.zeros(2)

    def ticks() -> None:
        for _ in range(_BATCH):
            crowd.advance(_ASIDE, command, surroundings.distance, surroundings.inverse_resolution)

    ticks()
    return _median(ticks, seconds)


def _median(batch: Any, seconds: float) -> float:
    medians = []
    for _ in range(REPETITIONS):
        times: list[float] = []
        stop = perf_counter() + seconds / REPETITIONS
        while perf_counter() < stop or not times:
            started = perf_counter()
            batch()
            times.append(perf_counter() - started)
        medians.append(statistics.median(times))
    return 1e6 * statistics.median(medians) / _BATCH


@kernel()
def _ticks(count, people, pose, command, surroundings, parameters, scratch):
    for _ in range(count):
        advance_people(people, pose, command, surroundings, parameters, scratch)
