"""What a robot's file says about a drive, as far as the user has not said otherwise."""

from __future__ import annotations

import math
from typing import Any

from lndrl.models import validate
from lndrl.planners import GuardConfig
from lndrl.robot.guard import Base
from lndrl.robot.limits import Limits
from lndrl.robot.shapes import RobotShape, load_shape
from lndrl.robot.topics import Topics

UNKNOWN = "generic"
"""The robot whose brakes and latency are taken where nobody has said which one it is."""


def fitted_topics(robot: RobotShape | None) -> Topics:
    """The usual topics, by the names that ``robot`` has for them."""
    if robot is None:
        return Topics()
    told = robot.topics
    names = {
        "scan": told.scan, "odometry": told.odometry, "map": told.map, "robot_pose": told.pose,
        "goal": told.goal, "command": told.command,
    }  # fmt: skip
    if told.people is not None:
        names["people_poses"] = told.people
    return Topics().renamed({purpose: f"/{name.strip('/')}" for purpose, name in names.items()})


def fitted_limits(asked: Limits, robot: RobotShape | None) -> Limits:
    """``asked``, and for the rest what ``robot`` can do."""
    if robot is None:
        return asked
    own = robot.acceleration
    braking = asked.braking
    if braking is None and asked.acceleration is None:
        braking = own.braking
    return Limits(
        asked.speed or robot.speed.linear,
        asked.turn or robot.speed.angular,
        asked.acceleration or own.linear,
        asked.turn_acceleration or own.angular,
        braking,
    )


def guard_bounds(robot: RobotShape | None, settings: dict[str, Any]) -> GuardConfig:
    """Bounds of a drive's guard: ``settings``, and as ``delay`` the robot's latency.

    Raises UserError for what is no bound.
    """
    latency = (robot or load_shape(UNKNOWN)).latency
    return validate(GuardConfig, {"delay": latency, **settings}, "--guard-set")


def guarded_base(robot: RobotShape | None, radius: float) -> Base:
    """What the guard goes by. Of a robot that nobody has named it is taken that velocities may rise
    at once, and fall as slowly as those of ``UNKNOWN``.
    """
    if robot is not None:
        return Base(radius, robot.acceleration.limits, robot.timeout)
    unknown = load_shape(UNKNOWN)
    return Base(radius, (math.inf, unknown.acceleration.limits[1], math.inf), unknown.timeout)


def guard_words(parameters: GuardConfig, base: Base) -> str:
    """What the guard takes for granted, in a line."""
    braking = base.limits[1]
    brakes = f"brakes by {braking:g} m/s²" if math.isfinite(braking) else "stops at once"
    speed, delay = parameters.people_speed, parameters.delay
    size = f"all of it is within {base.radius:.3g} m of its middle"
    return f"people walk up to {speed:g} m/s, it {brakes} and obeys within {delay:g} s, {size}"
