"""A scenario: the geometry of a place, who walks there, and where the robot starts and goes.

YAML under ``configs/scenarios/``. Metres, map frame, origin at the lower left corner; boxes are
``[x_min, y_min, x_max, y_max]``.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from lndrl.models import Model, Probability

Box = tuple[float, float, float, float]
Point = tuple[float, float]


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

    start: Box
    goal: Box
    via: list[Point] = Field(default_factory=list, description="waypoints between (m)")
    weight: float = Field(1.0, gt=0, description="relative share of pedestrians on this route")
    both_ways: bool = Field(True, description="half of them walk it in reverse")


class Pedestrians(Model):
    """The crowd (parameters §4.5)."""

    count: tuple[int, int] = Field((12, 16), description="fewest and most, drawn per episode")
    routes: list[Route] = Field(default_factory=list)
    orca: Probability = Field(0.5, description="chance that a pedestrian uses ORCA, else SFM")
    shuttle: Probability = Field(0.5, description="chance to walk back and forth, else to stay")

    @model_validator(mode="after")
    def _order(self) -> Pedestrians:
        if not 0 <= self.count[0] <= self.count[1]:
            raise ValueError(f"count {list(self.count)} must be [fewest, most]")
        if self.count[1] > 0 and not self.routes:
            raise ValueError("routes must name at least one route when there are pedestrians")
        return self


class RobotTask(Model):
    """One pair of regions that the robot's start and goal are drawn from."""

    start: Box
    goal: Box
    weight: float = Field(1.0, gt=0, description="relative share of episodes")
    both_ways: bool = Field(True, description="half of the episodes swap start and goal")


class Scenario(Model):
    """A place to navigate."""

    name: str
    description: str = ""
    kind: Literal["geometry"] = "geometry"
    size: tuple[float, float] = Field(description="width and height (m)")
    resolution: float = Field(0.05, gt=0, le=0.5, description="grid cell (m)")
    wall: float = Field(0.1, ge=0, description="thickness of the outer walls (m), 0 for none")
    obstacles: list[Obstacle] = Field(default_factory=list)
    pedestrians: Pedestrians
    robot: list[RobotTask] = Field(min_length=1)
    start_goal_distance: tuple[float, float] = Field(
        (0.0, 1e9), description="least and most start-goal distance (m); pairs are redrawn"
    )
