"""What a robot is like: how large, how fast, what its scanner sees, where it is heard and told.

A YAML file per robot (``configs/robots/``), strict as all others; and in words, where a robot is
not what a policy was trained for.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, model_validator

from lndrl.config import AccelerationConfig, RunConfig, find
from lndrl.localization import Scanner
from lndrl.models import (
    Count,
    Model,
    NonNegative,
    Positive,
    PositiveAngle,
    load_yaml,
    validate,
)

_CLOSE = 0.01  # m, rad, m/s: what nobody notices
_NARROW = 0.05  # rad of the field of view that may be missing


def _turn(angle: float) -> float:
    if abs(angle) > math.tau + _CLOSE:
        raise ValueError(
            f"{angle:g} is more than a turn; angles are in radians, and {angle:g} degrees are "
            f"{math.radians(angle):.4g}"
        )
    return angle


def _topic(name: str) -> str:
    if not name or name.strip("/") == "" or any(c.isspace() for c in name) or "//" in name:
        raise ValueError(f"{name!r} is no topic; write one like /scan or robot1/scan")
    return name


SignedAngle = Annotated[float, AfterValidator(_turn)]
Topic = Annotated[str, AfterValidator(_topic)]


class SpeedConfig(Model):
    """The fastest that the base drives and turns; a command beyond it is cut by the base."""

    linear: Positive = Field(description="m/s, forward")
    angular: Positive = Field(description="rad/s, either way")


class ScannerConfig(Model):
    """The scanner and where it stands on the base (REP-103: x forward, y left)."""

    x: float = Field(0.0, description="m ahead of the base's middle, between the wheels")
    y: float = Field(0.0, description="m to the left of it")
    yaw: SignedAngle = Field(0.0, description="rad, where its zero bearing points, to the left")
    upside_down: bool = Field(
        False, description="mounted with its axis down: it counts clockwise, seen from above"
    )
    field_of_view: PositiveAngle = Field(description="rad, all of it, around its zero bearing")
    beams: Count = Field(description="readings of a scan; a message may have others")
    range_min: NonNegative = Field(description="m; readings at or below are no echo")
    range_max: Positive = Field(description="m; readings at or beyond are no echo")

    @model_validator(mode="after")
    def _ranges_are_in_order(self) -> ScannerConfig:
        if self.range_max <= self.range_min:
            raise ValueError(
                f"range_max {self.range_max:g} m must be above range_min {self.range_min:g} m"
            )
        return self

    def scanner(self) -> Scanner:
        """What the filter and the guard take."""
        return Scanner(self.x, self.y, self.yaw, self.upside_down, self.range_min, self.range_max)


class TopicsConfig(Model):
    """Where it is heard and told; names as ``ros2 topic list`` shows them."""

    scan: Topic = Field("/scan", description="sensor_msgs/LaserScan")
    odometry: Topic = Field("/odom", description="nav_msgs/Odometry")
    map: Topic = Field("/map", description="nav_msgs/OccupancyGrid, transient local")
    pose: Topic = Field("/amcl_pose", description="geometry_msgs/PoseWithCovarianceStamped")
    goal: Topic = Field("/goal_pose", description="geometry_msgs/PoseStamped")
    command: Topic = Field("/cmd_vel", description="geometry_msgs/Twist, or TwistStamped")
    stamped: bool = Field(False, description="whether commands are TwistStamped")
    people: Topic | None = Field(None, description="geometry_msgs/PoseArray; null: no detector")


class RobotShape(Model):
    """``configs/robots/NAME.yaml``."""

    description: str = Field("", description="what robot this is, in a sentence")
    radius: Positive | None = Field(
        None, description="m of the disc around the base's middle that holds all of it"
    )
    footprint: list[tuple[float, float]] | None = Field(
        None, min_length=3, description="corners [x, y] in m around the base's middle, instead"
    )
    speed: SpeedConfig = Field(description="the fastest that it drives and turns")
    acceleration: AccelerationConfig = Field(
        AccelerationConfig(), description="how fast its velocities change; the guard needs braking"
    )
    latency: Annotated[float, Field(ge=0, le=5)] = Field(
        0.1, description="s from the moment of a scan until a command of it is felt by the wheels"
    )
    timeout: Annotated[float, Field(ge=0, le=5)] = Field(
        0.5, description="s without a command after which the base brakes by itself; measure it"
    )
    scanner: ScannerConfig = Field(description="its scanner")
    topics: TopicsConfig = Field(TopicsConfig(), description="where it is heard and told")

    @model_validator(mode="after")
    def _one_size(self) -> RobotShape:
        if (self.radius is None) == (self.footprint is None):
            raise ValueError("name either radius or footprint")
        if self.footprint is not None and not all(
            math.isfinite(each) for corner in self.footprint for each in corner
        ):
            raise ValueError("footprint must be finite numbers")
        return self

    @property
    def reach(self) -> float:
        """m from the base's middle to its farthest part: the radius of what policies are told."""
        if self.radius is not None:
            return float(self.radius)
        assert self.footprint is not None
        return max(math.hypot(x, y) for x, y in self.footprint)


def load_shape(named: Path | str) -> RobotShape:
    """The robot of that name (``configs/robots``), or of a YAML file; raises UserError."""
    path = find("robot", named)
    return validate(RobotShape, load_yaml(path), str(path))


def world_of(shape: RobotShape) -> dict[str, Any]:
    """What a configuration's ``world`` would say to train for ``shape``, as far as it has keys."""
    limits = shape.acceleration.model_dump()
    return {"robot_radius": shape.reach, "robot": {"acceleration": limits}}


def planned_for(shape: RobotShape, config: RunConfig) -> RunConfig:
    """``config`` for a planner that plans with the size and the accelerations of ``shape``."""
    robot = config.world.robot.model_copy(update={"acceleration": shape.acceleration})
    world = config.world.model_copy(update={"robot_radius": shape.reach, "robot": robot})
    return config.model_copy(update={"world": world})


def rehearsed(shape: RobotShape, config: RunConfig) -> RunConfig:
    """``config`` with a world in which a robot like ``shape`` drives, and sees what it sees."""
    config, scanner = planned_for(shape, config), shape.scanner
    laser = config.world.laser.model_copy(
        update={
            "beams": scanner.beams,
            "field_of_view": scanner.field_of_view,
            "range_max": scanner.range_max,
        }
    )
    return config.model_copy(update={"world": config.world.model_copy(update={"laser": laser})})


def differences(shape: RobotShape, config: RunConfig) -> list[str]:
    """In sentences, where ``shape`` is not the robot that a policy of ``config`` was trained for.

    Only what makes the policy see less, do other than it meant, or come nearer to things than it
    learned; nothing where the robot can more.
    """
    return [*_sight(shape, config), *_motion(shape, config), *_size(shape, config)]


def _sight(shape: RobotShape, config: RunConfig) -> list[str]:
    scanner, laser = shape.scanner, config.world.laser
    said = []
    missing = _unseen(scanner, laser.field_of_view)
    if missing > _NARROW:
        said.append(
            f"its scanner sees {math.degrees(laser.field_of_view - missing):.0f} of the "
            f"{math.degrees(laser.field_of_view):.0f} degrees ahead that the policy was trained "
            "with; the rest will look free to it"
        )
    if scanner.range_max < laser.range_max - _CLOSE:
        said.append(
            f"its scanner sees {scanner.range_max:g} m far, the policy was trained with "
            f"{laser.range_max:g} m; what is farther will look free to it, and in large rooms it "
            "may lose its way"
        )
    blind = scanner.range_min - shape.reach + math.hypot(scanner.x, scanner.y)
    if blind > _CLOSE:
        said.append(
            f"its scanner sees nothing nearer than {scanner.range_min:g} m, which is up to "
            f"{100.0 * blind:.0f} cm from the robot's edge; what is there will look free"
        )
    step = laser.field_of_view / laser.beams
    own = scanner.field_of_view / scanner.beams
    if own > 2.0 * step:
        said.append(
            f"its beams are {math.degrees(own):.2g} degrees apart, the policy was trained with "
            f"{math.degrees(step):.2g}; thin things may stand between two of them"
        )
    return said


def _unseen(scanner: ScannerConfig, wanted: float) -> float:
    """rad of the ``wanted`` field of view ahead that ``scanner`` does not cover."""
    half = 0.5 * scanner.field_of_view
    if half >= math.pi - _CLOSE:
        return 0.0
    middle = math.remainder(scanner.yaw, math.tau)
    covered = 0.0
    # Once around on either side: a scanner that looks backward may cover both ends.
    for turn in (-math.tau, 0.0, math.tau):
        low = max(middle + turn - half, -0.5 * wanted)
        high = min(middle + turn + half, 0.5 * wanted)
        covered += max(0.0, high - low)
    return max(0.0, wanted - covered)


def _motion(shape: RobotShape, config: RunConfig) -> list[str]:
    task, said = config.task, []
    fastest = max(abs(v) for v in task.linear_velocities)
    turning = max(abs(w) for w in task.angular_velocities)
    if shape.speed.linear < fastest - _CLOSE:
        said.append(
            f"it drives {shape.speed.linear:g} m/s at most, the policy asks for up to "
            f"{fastest:g} m/s; it will be slower than people expect and later than it plans"
        )
    if shape.speed.angular < turning - _CLOSE:
        said.append(
            f"it turns {shape.speed.angular:g} rad/s at most, the policy asks for up to "
            f"{turning:g} rad/s; it will turn too little"
        )
    own, trained = shape.acceleration.limits, config.world.robot.acceleration.limits
    if any(mine < 0.99 * learned for mine, learned in zip(own, trained, strict=True)):
        than = "do so at once" if math.isinf(min(trained)) else f"have {_limits(trained)}"
        said.append(
            f"its velocities change no faster than {_limits(own)}, so that it drives "
            f"{fastest:g} m/s {fastest / own[0]:.2g} s after it was told and stands "
            f"{fastest / own[1]:.2g} s after that; those of the robot that the policy was trained "
            f"with {than}: fine-tune it with world.robot.acceleration"
        )
    return said


def _limits(limits: tuple[float, float, float]) -> str:
    gain, loss, turn = (f"{each:g}" if math.isfinite(each) else "any" for each in limits)
    braking = "" if loss == gain else f" ({loss} m/s² to brake)"
    return f"{gain} m/s²{braking} and {turn} rad/s²"


def _size(shape: RobotShape, config: RunConfig) -> list[str]:
    larger = shape.reach - config.world.robot_radius
    if larger <= _CLOSE:
        return []
    return [
        f"its radius is {shape.reach:.3g} m, the policy was trained with "
        f"{config.world.robot_radius:g} m; it will pass things {100.0 * larger:.0f} cm nearer than "
        "it learned"
    ]
