"""A scenario: a place, who walks there, and where the robot starts and goes.

YAML under ``configs/scenarios/``. Metres, map frame; boxes are ``[x_min, y_min, x_max, y_max]``.
Kinds of place: ``geometry`` lists its obstacles (origin at the lower left corner), ``map`` names
a ROS map (the map's own frame), ``random`` stands for endless generated layouts, ``mixed`` for
several places, among which worlds move.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lndrl.extensions import PartName, PartSettings
from lndrl.models import LATER, Count, Model, NonNegative, Probability

Box = tuple[float, float, float, float]
Point = tuple[float, float]

SMALLEST_RANDOM = 12.0  # m; below it no start and goal are far enough apart
MOST_CELLS = 5e7
BLOCKS = "blocks"
"""The built-in generator of random layouts."""


class Obstacle(Model):
    """One solid obstacle; exactly one of the shapes."""

    box: Box | None = Field(None, description="x_min, y_min, x_max, y_max (m)")
    circle: tuple[float, float, float] | None = Field(None, description="x, y, radius (m)")
    polygon: list[Point] | None = Field(None, description="corners in order (m), at least 3")

    @model_validator(mode="after")
    def _one_shape(self) -> Obstacle:
        shapes = [s for s in (self.box, self.circle, self.polygon) if s is not None]
        if len(shapes) != 1:
            raise ValueError("an obstacle needs exactly one of box, circle, polygon")
        if self.box and not (self.box[0] < self.box[2] and self.box[1] < self.box[3]):
            raise ValueError(f"box {list(self.box)} must be [x_min, y_min, x_max, y_max]")
        if self.circle and self.circle[2] <= 0:
            raise ValueError("a circle's radius must be above 0")
        if self.polygon and len(self.polygon) < 3:
            raise ValueError("a polygon needs at least 3 corners")
        return self


class Route(Model):
    """Where some pedestrians walk: from one region through waypoints to another."""

    start: Box = Field(description="where they begin: x_min, y_min, x_max, y_max (m)")
    goal: Box = Field(description="where they go: x_min, y_min, x_max, y_max (m)")
    via: list[Point] = Field(default_factory=list, description="waypoints between (m)")
    weight: float = Field(1.0, gt=0, description="relative share of pedestrians on this route")
    both_ways: bool = Field(True, description="half of them walk it in reverse")


class Pedestrians(Model):
    """The crowd (GROUP). On maps and random layouts routes are found by themselves."""

    count: tuple[int, int] = Field((12, 16), description="fewest and most, drawn per episode")
    routes: list[Route] = Field(
        default_factory=list,
        description="ways between two regions; on maps and random layouts found by themselves",
    )
    orca: Probability = Field(0.5, description="chance that a pedestrian uses ORCA, else SFM")
    shuttle: Probability = Field(0.5, description="chance to walk back and forth, else to stay")

    @model_validator(mode="after")
    def _order(self) -> Pedestrians:
        if not 0 <= self.count[0] <= self.count[1]:
            raise ValueError(f"count {list(self.count)} must be [fewest, most]")
        return self


class RobotTask(Model):
    """One pair of regions that the robot's start and goal are drawn from."""

    start: Box = Field(description="where it starts: x_min, y_min, x_max, y_max (m)")
    goal: Box = Field(description="where it goes: x_min, y_min, x_max, y_max (m)")
    weight: float = Field(1.0, gt=0, description="relative share of episodes")
    both_ways: bool = Field(True, description="half of the episodes swap start and goal")


class MapCells(Model):
    """A map's cells inside the scenario: what ``map`` names, once it has been read.

    So a run's configuration is complete: actors on other machines need no file, and a run can be
    resumed when the map has moved.
    """

    rows: Count = Field(description="cells along y, the lowest row first")
    columns: Count = Field(description="cells along x")
    origin: Point = Field(description="map frame position of the lower left corner (m)")
    data: str = Field(
        description="base64 of deflated bytes: 0 free, 1 occupied, 2 unknown, 3 where the image "
        "ends beside floor"
    )
    notes: Annotated[list[str], LATER] = Field(
        default_factory=list, description="what its owner should know of how the map was read"
    )


class Mix(Model):
    """How often each kind of ground occurs in random layouts, relative to the others."""

    rooms: NonNegative = Field(1.0, description="weight of rooms behind doors")
    corridors: NonNegative = Field(1.0, description="weight of corridors")
    clutter: NonNegative = Field(1.0, description="weight of ground full of obstacles")
    open: NonNegative = Field(1.0, description="weight of nearly empty ground")

    @model_validator(mode="after")
    def _some(self) -> Mix:
        if self.rooms + self.corridors + self.clutter + self.open <= 0:
            raise ValueError("at least one of rooms, corridors, clutter, open must be above 0")
        return self


Stay = Annotated[
    Count,
    LATER,
    Field(description="episodes that a world spends in one layout before it moves to another"),
]


class RandomLayouts(Model):
    """Which layouts a ``random`` scenario stands for."""

    seed: int = Field(1, ge=0, description="another seed, other layouts")
    layouts: Count = Field(1000, description="how many different ones worlds are spread over")
    mix: Mix = Field(Mix(), description="how often each kind of ground occurs")
    generator: Annotated[PartName, LATER] = Field(
        BLOCKS, description="blocks, or a class of your own (docs/extend/scenario.md)"
    )
    settings: Annotated[PartSettings, LATER] = Field(
        default_factory=dict, description="keyword arguments of a class of your own"
    )
    episodes: Stay = 50

    @model_validator(mode="after")
    def _own_is_whole(self) -> RandomLayouts:
        if self.settings and self.generator == BLOCKS:
            raise ValueError("settings go to a generator of your own; blocks has mix")
        if self.mix != Mix() and self.generator != BLOCKS:
            raise ValueError("mix belongs to generator: blocks; one of your own has settings")
        return self


class Part(Model):
    """One of the places of a mixture."""

    scenario: Scenario = Field(description="a place: its name, a YAML file, or keys; not mixed")
    weight: float = Field(1.0, gt=0, description="relative share of the layouts")


class Mixture(Model):
    """Which places a ``mixed`` scenario stands for."""

    places: list[Part] = Field(min_length=1, description="the places, and how much of each")
    seed: int = Field(1, ge=0, description="another seed, other layouts of each place")
    layouts: Count = Field(1000, description="how many draws of a place worlds are spread over")
    episodes: Stay = 50


class Scenario(Model):
    """A place to navigate; ``kind`` decides which of the fields it may have."""

    name: str = Field(description="what tables and pictures call the place")
    description: str = Field("", description="one line that lndrl scenarios shows")
    version: int = Field(0, ge=0, description="raised when a place that results name changes")
    kind: Literal["geometry", "map", "random", "mixed"] = Field(
        "geometry",
        description="geometry lists its obstacles, map names a ROS map, random stands for endless "
        "generated layouts, mixed for several places",
    )
    size: Point = Field((0.0, 0.0), description="width and height (m); a map has its own")
    resolution: float = Field(0.05, gt=0, le=0.5, description="grid cell (m); a map has its own")
    wall: float = Field(0.1, ge=0, description="thickness of the outer walls (m), 0 for none")
    obstacles: list[Obstacle] = Field(
        default_factory=list, description="of kind geometry: what stands inside the outer walls"
    )
    map: str | None = Field(None, description="ROS map_server YAML, relative to this file")
    cells: MapCells | None = Field(None, description="filled in when the map is read")
    inside: Annotated[Point | None, LATER] = Field(
        None,
        description="x, y of a point (m, map frame) on the floor of a map that people and tasks "
        "are to be found on. Default: the largest floor",
    )
    random: RandomLayouts | None = Field(None, description="of kind random; default: all defaults")
    mixed: Annotated[Mixture | None, LATER] = Field(None, description="of kind mixed: its places")
    pedestrians: Pedestrians = Field(Pedestrians(), description="who walks there")
    robot: list[RobotTask] = Field(
        default_factory=list,
        description="regions that the robot starts in and goes to; on maps and random layouts "
        "found, if none is given",
    )
    start_goal_distance: tuple[float, float] | None = Field(
        None,
        description="least and most start-goal distance (m); pairs are redrawn. Default: any for "
        "geometry, 11 to 13 for random layouts, and for maps as near to that as they offer",
    )

    @property
    def map_notes(self) -> tuple[str, ...]:
        """What a map's owner should know of how it was read; nothing of other kinds."""
        return tuple(note for s in self.parts for note in (s.cells.notes if s.cells else ()))

    @property
    def parts(self) -> tuple[Scenario, ...]:
        """The places that it stands for: those of a mixture, else itself."""
        return tuple(part.scenario for part in self.mixed.places) if self.mixed else (self,)

    @property
    def layouts(self) -> RandomLayouts | Mixture | None:
        """How worlds move among its layouts; None for a scenario that has but one."""
        if self.kind == "random":
            return self.random or RandomLayouts()
        return self.mixed

    @model_validator(mode="after")
    def _fits_its_kind(self) -> Scenario:
        if self.kind != "mixed" and self.mixed is not None:
            raise ValueError("mixed needs kind: mixed")
        getattr(self, f"_check_{self.kind}")()
        if self.kind != "map" and (self.map is not None or self.cells is not None):
            raise ValueError("map needs kind: map")
        if self.kind != "map" and self.inside is not None:
            raise ValueError("inside needs kind: map; it chooses a floor of a map")
        if self.kind != "random" and self.random is not None:
            raise ValueError("random needs kind: random")
        limits = self.start_goal_distance
        if limits is not None and not 0 <= limits[0] <= limits[1]:
            raise ValueError(f"start_goal_distance {list(limits)} must be [least, most]")
        return self

    def _check_geometry(self) -> None:
        self._check_size()
        if not self.robot:
            raise ValueError("robot = []: must name at least one start and goal")
        if self.pedestrians.count[1] > 0 and not self.pedestrians.routes:
            raise ValueError("pedestrians.routes must name at least one route for the pedestrians")

    def _check_map(self) -> None:
        if self.map is None and self.cells is None:
            raise ValueError("map is missing; name a ROS map_server YAML, e.g. map: office.yaml")
        if self.obstacles:
            raise ValueError("obstacles go with kind: geometry; draw them into the map")

    def _check_random(self) -> None:
        self._check_size()
        if min(self.size) < SMALLEST_RANDOM:
            raise ValueError(
                f"size {list(self.size)}: random layouts need {SMALLEST_RANDOM:g} m or more"
            )
        if self.obstacles or self.robot or self.pedestrians.routes:
            raise ValueError(
                "obstacles, robot and pedestrians.routes are generated; leave them out"
            )

    def _check_mixed(self) -> None:
        if self.mixed is None:
            raise ValueError("mixed is missing; name its places, e.g. mixed: {places: [...]}")
        for part in self.mixed.places:
            if part.scenario.kind == "mixed":
                raise ValueError(
                    f"mixed.places: {part.scenario.name} is mixed itself; name its places instead"
                )
        plain = Scenario.model_construct(name=self.name)
        given = ("size", "resolution", "wall", "obstacles", "robot", "pedestrians")
        for name in (*given, "start_goal_distance"):
            if getattr(self, name) != getattr(plain, name):
                raise ValueError(f"{name} belongs to each of mixed.places; leave it out here")

    def _check_size(self) -> None:
        if min(self.size) <= 0:
            raise ValueError(f"size {list(self.size)} must be [width, height] above 0 (m)")
        if self.size[0] * self.size[1] / self.resolution**2 > MOST_CELLS:
            raise ValueError(
                f"size {list(self.size)} has more than {MOST_CELLS:.0e} cells of "
                f"{self.resolution:g} m; choose a coarser resolution"
            )


Part.model_rebuild()  # it names what is defined after it
