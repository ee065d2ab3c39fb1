"""Endless layouts for training beyond one map: rooms, corridors, clutter and open space.

A layout is a pure function of (the scenario's seed, its number). The floor is cut into blocks by
straight aisles, which join everything; each block becomes one of the four kinds of ground and
opens to the aisles around it. What comes out is a plain geometry scenario. A generator of the
user's own may draw instead.
"""

from __future__ import annotations

import numpy as np

from lndrl.errors import UserError
from lndrl.extensions import GENERATOR, calling, find, make
from lndrl.maps.grid import distance_field, grid_from_scenario
from lndrl.models import validate
from lndrl.randomness import State, stream_state, uniform
from lndrl.scenario import BLOCKS, Box, Obstacle, Point, RandomLayouts, Scenario
from lndrl.world.furnish import TASK_DISTANCE, find_people, find_tasks

_ATTEMPTS = 20
_STREAM = 77  # keeps these draws apart from those of worlds
_OWN_STREAM = 78  # and from those of a generator of the user's own
_MIXED_STREAM = 79  # and from those of what is drawn among places
_NOWHERE = {"start": (0.0, 0.0, 0.0, 0.0), "goal": (0.0, 0.0, 0.0, 0.0)}
_AISLE = (0.8, 1.4)  # m from a block's edge to what stands in it: half an aisle
_SMALLEST_BLOCK = 5.5  # m
_WALL = 0.15  # m
_DOOR = (1.2, 2.2)  # m
_GAP = 1.1  # m between obstacles of a clutter
_PLACINGS = 200


def layout_number(scenario: Scenario, seed: int, world: int) -> int:
    """Which layout ``world`` of the run ``seed`` plays; 0 for a scenario that has but one."""
    layouts = scenario.layouts
    if layouts is None:
        return 0
    return int(stream_state(seed, world, _STREAM)[0] % np.uint64(layouts.layouts))


def place_of(scenario: Scenario, index: int) -> tuple[Scenario, int]:
    """The place that layout ``index`` of ``scenario`` is in, and which layout of that place.

    The scenario itself unless it is mixed: then one of its places, drawn by weight.
    """
    if scenario.mixed is None:
        return scenario, index
    index %= scenario.mixed.layouts
    places = scenario.mixed.places
    state = stream_state(scenario.mixed.seed, index, _MIXED_STREAM)
    left = float(uniform(state)) * sum(part.weight for part in places)
    for part in places:
        left -= part.weight
        if left < 0.0:
            return part.scenario, index
    return places[-1].scenario, index


def generate(scenario: Scenario, index: int, robot_radius: float = 0.17) -> Scenario:
    """Layout ``index`` (taken modulo ``layouts``) of a random scenario, of kind geometry.

    Its floor is one connected part, its tasks lie at ``start_goal_distance`` (default 11 to
    13 m), its people have routes around the walls. Raises UserError when no layout of that size
    can hold them, and for a generator of one's own that is not trusted, or fails.
    """
    settings = _settings(scenario)
    index %= settings.layouts
    own = None if settings.generator == BLOCKS else OwnLayouts(scenario, settings)
    diagonal = float(np.hypot(*scenario.size))
    nearest = (scenario.start_goal_distance or TASK_DISTANCE)[0]
    if own is None and nearest > diagonal:
        raise UserError(
            f"scenario {scenario.name}: no layout of {diagonal:.1f} m from corner to corner has "
            f"start and goal {nearest:g} m apart; enlarge size or change start_goal_distance"
        )
    reason = ""
    # Another attempt is sooner made than a search; only where none offers a task it is searched.
    for searching in (False, True):
        for attempt in range(_ATTEMPTS):
            if own is not None:
                layout = own(index, attempt)
            else:
                state = stream_state(settings.seed, index, attempt, _STREAM)
                layout = _draw(scenario, index, state)
            try:
                return _furnish(layout, robot_radius, searching)
            except UserError as error:
                reason = str(error)
    raise UserError(
        f"scenario {scenario.name}: none of {_ATTEMPTS} attempts at layout {index} offers room "
        f"({reason}); enlarge size or change start_goal_distance"
    )


class OwnLayouts:
    """The generator that ``settings`` names, made for ``scenario``.

    Raises UserError where it is not trusted, not there, or not what it should be.
    """

    def __init__(self, scenario: Scenario, settings: RandomLayouts) -> None:
        self._scenario, self._settings = scenario, settings
        name = settings.generator
        found = find(GENERATOR, name, (BLOCKS,), "random.generator")
        assert found is not None  # blocks has been dealt with
        self._generator = make(GENERATOR, found, name, scenario, **settings.settings)

    def __call__(self, index: int, attempt: int) -> Scenario:
        """Layout ``index`` at its ``attempt``: a function of these and the scenario alone.

        Raises UserError for whatever is no scenario, or an impossible one.
        """
        name = self._settings.generator
        sequence = np.random.SeedSequence(
            self._settings.seed, spawn_key=(_OWN_STREAM, index, attempt)
        )
        with calling(GENERATOR, name):
            layout = self._generator(index, np.random.Generator(np.random.PCG64(sequence)))
        if not isinstance(layout, Scenario):
            raise UserError(
                f"scenario generator {name}: layout {index} must be a Scenario, "
                f"not {type(layout).__name__}"
            )
        return self._checked(layout, index)

    def _checked(self, layout: Scenario, index: int) -> Scenario:
        """``layout`` as a geometry scenario, validated: a copy with changes has not been yet.

        Tasks and routes that it leaves out are left out.
        """
        data = layout.model_dump(warnings=False)  # validate() says what is wrong
        if layout.map is not None or layout.cells is not None:
            raise UserError(
                f"scenario generator {self._settings.generator}: layout {index} is a map; "
                "draw obstacles instead"
            )
        tasks, crowd = data["robot"], data["pedestrians"]
        routes = crowd.get("routes") if isinstance(crowd, dict) else None
        # Of kind geometry a scenario needs both; where they are to be found, others stand in.
        data["robot"] = tasks or [_NOWHERE]
        if isinstance(crowd, dict):
            data["pedestrians"] = {**crowd, "routes": routes or [_NOWHERE]}
        data |= {"kind": "geometry", "random": None, "name": f"{self._scenario.name}-{index}"}
        where = f"scenario generator {self._settings.generator}: layout {index}"
        checked = validate(Scenario, data, where)
        people = checked.pedestrians
        return checked.model_copy(
            update={
                "robot": checked.robot if tasks else [],
                "pedestrians": people if routes else people.model_copy(update={"routes": []}),
            }
        )


def _settings(scenario: Scenario) -> RandomLayouts:
    return scenario.random or RandomLayouts()


def _furnish(layout: Scenario, robot_radius: float, searching: bool) -> Scenario:
    grid = grid_from_scenario(layout)
    distance = distance_field(grid.occupied, grid.resolution)
    if not layout.robot:
        wanted = layout.start_goal_distance or TASK_DISTANCE
        tasks, limits, _ = find_tasks(
            distance, grid.resolution, robot_radius, wanted, layout.name, searching
        )
        layout = layout.model_copy(update={"robot": tasks, "start_goal_distance": limits})
    people, note = find_people(layout.pedestrians, distance, grid.resolution)
    if note:
        raise UserError(note)
    return layout.model_copy(update={"pedestrians": people})


def _draw(scenario: Scenario, index: int, state: State) -> Scenario:
    mix = _settings(scenario).mix
    kinds = (("rooms", _room), ("corridors", _corridor), ("clutter", _clutter), ("open", _open))
    weights = [getattr(mix, name) for name, _ in kinds]
    width, height = scenario.size
    wall = scenario.wall
    obstacles: list[Obstacle] = []
    for block in _cut((wall, wall, width - wall, height - wall), state):
        left = uniform(state) * sum(weights)
        for (_, fill), weight in zip(kinds, weights, strict=True):
            left -= weight
            if left < 0.0:
                obstacles += fill(block, state)
                break
    return scenario.model_copy(
        update={
            "kind": "geometry",
            "random": None,
            "name": f"{scenario.name}-{index}",
            "obstacles": obstacles,
        }
    )


def _cut(block: Box, state: State) -> list[Box]:
    """Blocks of a floor, cut across the longer side until they are small."""
    x0, y0, x1, y1 = block
    width, height = x1 - x0, y1 - y0
    longer = max(width, height)
    if longer < 2 * _SMALLEST_BLOCK or (longer < 11.0 and uniform(state) < 0.5):
        return [block]
    at = _between(state, _SMALLEST_BLOCK, longer - _SMALLEST_BLOCK)
    if width >= height:
        return _cut((x0, y0, x0 + at, y1), state) + _cut((x0 + at, y0, x1, y1), state)
    return _cut((x0, y0, x1, y0 + at), state) + _cut((x0, y0 + at, x1, y1), state)


def _room(block: Box, state: State) -> list[Obstacle]:
    """Four walls with doors in two or three of them, at times a wall across, some furniture."""
    x0, y0, x1, y1 = _inside(block, state)
    sides = [("y", y0, x0, x1), ("y", y1, x0, x1), ("x", x0, y0, y1), ("x", x1, y0, y1)]
    doors = 2 + int(uniform(state) * 2)
    first = int(uniform(state) * 4)
    with_door = {(first + k * (2 if doors == 2 else 1)) % 4 for k in range(doors)}
    out: list[Obstacle] = []
    for k, (axis, at, low, high) in enumerate(sides):
        out += _wall(axis, at, low, high, state, openings=1 if k in with_door else 0)
    if max(x1 - x0, y1 - y0) > 6.0 and uniform(state) < 0.6:
        if x1 - x0 > y1 - y0:
            out += _wall("x", _between(state, x0 + 2.5, x1 - 2.5), y0, y1, state, openings=1)
        else:
            out += _wall("y", _between(state, y0 + 2.5, y1 - 2.5), x0, x1, state, openings=1)
    furniture = [_box_at(state, 0.4, 1.2) for _ in range(int(uniform(state) * 4))]
    return out + _scattered((x0 + 1.6, y0 + 1.6, x1 - 1.6, y1 - 1.6), furniture, state)


def _corridor(block: Box, state: State) -> list[Obstacle]:
    """Parallel walls along the longer side, with openings, and benches along them."""
    x0, y0, x1, y1 = _inside(block, state)
    along_x = x1 - x0 >= y1 - y0
    low, high, near, far = (x0, x1, y0, y1) if along_x else (y0, y1, x0, x1)
    out: list[Obstacle] = []
    at = near
    while at < far + 1e-9:
        out += _wall("y" if along_x else "x", at, low, high, state, openings=1 + (high - low > 9))
        lane = _between(state, 2.0, 3.2)
        if at + lane < far and uniform(state) < 0.7:
            bench = _between(state, low, high - 1.2)
            side = (bench, at + _WALL, bench + 1.2, at + _WALL + 0.4)
            out.append(Obstacle(box=_rounded(side if along_x else (*side[1::-1], *side[:1:-1]))))
        at += lane
    return out


def _clutter(block: Box, state: State) -> list[Obstacle]:
    """Boxes, pillars and polygons, as many as find room."""
    area = _inside(block, state)
    size = (area[2] - area[0]) * (area[3] - area[1])
    shapes = []
    for _ in range(max(2, int(size * _between(state, 0.10, 0.25)))):
        kind = uniform(state)
        if kind < 0.4:
            shapes.append(_box_at(state, 0.3, 1.4))
        elif kind < 0.7:
            shapes.append(Obstacle(circle=(0.0, 0.0, round(_between(state, 0.15, 0.5), 2))))
        else:
            shapes.append(_polygon_at(state))
    return _scattered(area, shapes, state)


def _open(block: Box, state: State) -> list[Obstacle]:
    """Nothing, or a single pillar."""
    if uniform(state) < 0.6:
        return []
    pillar = Obstacle(circle=(0.0, 0.0, round(_between(state, 0.15, 0.35), 2)))
    return _scattered(_inside(block, state), [pillar], state)


def _inside(block: Box, state: State) -> Box:
    inset = _between(state, *_AISLE)
    return (block[0] + inset, block[1] + inset, block[2] - inset, block[3] - inset)


def _wall(
    axis: str, at: float, low: float, high: float, state: State, openings: int
) -> list[Obstacle]:
    """A wall across ``axis`` at ``at`` from ``low`` to ``high`` (m) with doors in it."""
    out, start = [], low
    stretch = (high - low) / max(openings, 1)
    for k in range(openings):
        door = min(_between(state, *_DOOR), stretch - 1.0)
        begin = low + k * stretch + _between(state, 0.4, max(0.4, stretch - door - 0.4))
        out.append(_piece(axis, at, start, begin))
        start = begin + door
    out.append(_piece(axis, at, start, high + _WALL))
    return out


def _piece(axis: str, at: float, low: float, high: float) -> Obstacle:
    if axis == "x":
        return Obstacle(box=_rounded((at, low, at + _WALL, high)))
    return Obstacle(box=_rounded((low, at, high, at + _WALL)))


def _scattered(area: Box, shapes: list[Obstacle], state: State) -> list[Obstacle]:
    """``shapes`` (drawn around the origin) moved to where they keep ``_GAP`` to each other."""
    out: list[Obstacle] = []
    taken: list[tuple[float, float, float]] = []
    for shape in shapes:
        reach = _reach(shape)
        for _ in range(_PLACINGS // len(shapes)):
            if min(area[2] - area[0], area[3] - area[1]) <= 2 * reach:
                break
            x = _between(state, area[0] + reach, area[2] - reach)
            y = _between(state, area[1] + reach, area[3] - reach)
            if all(np.hypot(x - a, y - b) >= reach + r + _GAP for a, b, r in taken):
                taken.append((x, y, reach))
                out.append(_moved(shape, round(x, 2), round(y, 2)))
                break
    return out


def _box_at(state: State, least: float, most: float) -> Obstacle:
    a, b = 0.5 * _between(state, least, most), 0.5 * _between(state, least, most)
    return Obstacle(box=_rounded((-a, -b, a, b)))


def _polygon_at(state: State) -> Obstacle:
    """Five to eight corners at uneven distances and angles."""
    corners = 5 + int(uniform(state) * 4)
    size = _between(state, 0.35, 1.0)
    points: list[Point] = []
    for k in range(corners):
        angle = 2.0 * np.pi * (k + 0.6 * uniform(state)) / corners
        radius = size * _between(state, 0.5, 1.0)
        points.append((round(radius * np.cos(angle), 2), round(radius * np.sin(angle), 2)))
    return Obstacle(polygon=points)


def _reach(shape: Obstacle) -> float:
    if shape.box is not None:
        return float(np.hypot(shape.box[2], shape.box[3]))
    if shape.circle is not None:
        return shape.circle[2]
    return max(float(np.hypot(*p)) for p in shape.polygon or [])


def _moved(shape: Obstacle, x: float, y: float) -> Obstacle:
    if shape.box is not None:
        a, b, c, d = shape.box
        return Obstacle(box=_rounded((a + x, b + y, c + x, d + y)))
    if shape.circle is not None:
        return Obstacle(circle=(x, y, shape.circle[2]))
    points = [(round(a + x, 2), round(b + y, 2)) for a, b in shape.polygon or []]
    return Obstacle(polygon=points)


def _rounded(box: tuple[float, ...]) -> Box:
    a, b, c, d = (round(float(v), 2) for v in box)
    return a, b, c, d


def _between(state: State, low: float, high: float) -> float:
    return low + (high - low) * float(uniform(state))
