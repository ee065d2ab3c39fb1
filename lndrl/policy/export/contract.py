"""What a robot must supply and what it gets: the contract beside an exported policy.

Every number comes from the configuration that the policy was trained under.
"""

from __future__ import annotations

import hashlib
from typing import Any

from lndrl.config import RunConfig
from lndrl.navigation import action_table
from lndrl.policy.blob import metadata_in
from lndrl.policy.export.graph import OUTPUT, ROWS, example_inputs, goal_values
from lndrl.policy.weights import driven_at
from lndrl.version import VERSION

CONTRACT_VERSION = 1
"""Rises when a key changes its meaning or goes; a new key is no reason."""
METADATA_KEY = "lndrl.contract"
"""Entry of the model's metadata that holds the contract as JSON, too."""

_FRAMES = (
    "REP-103: x forward, y left, angles counter-clockwise; metres, seconds, radians. The robot "
    "frame lies in the laser, which is in the robot's middle and looks ahead."
)


def contract_for(config: RunConfig, weights: bytes, opset: int) -> dict[str, Any]:
    """The contract, plain data for JSON, of a policy of ``config`` with ``weights``."""
    inputs = example_inputs(config)
    described = {"scan": _scan, "people": _people, "count": _count, "goal": _goal}
    return {
        "contract": CONTRACT_VERSION,
        "made_by": f"lndrl {VERSION}",
        "opset": opset,
        "policy": _policy(config, weights),
        "frames": _FRAMES,
        "inputs": [
            {
                "name": name,
                "dtype": str(tensor.dtype).removeprefix("torch."),
                "shape": [ROWS, *tensor.shape[1:]],
                **described[name](config),
            }
            for name, tensor in inputs.items()
        ],
        "outputs": [_output(config, driven_at(weights))],
        "actions": [
            {"index": i, "v": float(v), "w": float(w)}
            for i, (v, w) in enumerate(action_table(config.task))
        ],
        "timing": _timing(config),
        "task": _task(config),
    }


def _policy(config: RunConfig, weights: bytes) -> dict[str, Any]:
    """Which weights these are; version and steps are None where the file does not say them."""
    version: int | None
    steps: int | None
    try:
        said = metadata_in(weights)
        version, steps = int(said["lndrl.version"]), int(said["lndrl.steps"])
    except (ValueError, KeyError, TypeError):
        version = steps = None
    return {
        "version": version,
        "steps": steps,
        "weights_sha256": hashlib.sha256(weights).hexdigest(),
        "configuration": config.content_hash(),
        "scenario": config.scenario.name,
        "temperature": driven_at(weights),
    }


def _scan(config: RunConfig) -> dict[str, Any]:
    laser, frames = config.world.laser, config.task.scan_frames
    described: dict[str, Any] = {
        "unit": "m",
        "meaning": "laser ranges, raw, by rising bearing",
        "beams": laser.beams,
        "field_of_view": laser.field_of_view,
        "first_bearing": -0.5 * laser.field_of_view,
        "bearing_increment": laser.field_of_view / laser.beams,
        "last_bearing": (0.5 - 1.0 / laser.beams) * laser.field_of_view,
        "range_max": laser.range_max,
        "no_echo": "NaN, infinity and all beyond range_max read as range_max, below 0 as 0; "
        "a driver that says 0 for no echo must say infinity",
        "scans": frames,
    }
    if frames > 1:
        described["order"] = (
            f"{frames} scans, the oldest first, the newest last, one control period apart; "
            f"an episode begins with its first scan {frames} times"
        )
    return described


def _people(config: RunConfig) -> dict[str, Any]:
    task = config.task
    return {
        "columns": ["x", "y", "vx", "vy"],
        "unit": ["m", "m", "m/s", "m/s"],
        "frame": "robot",
        "meaning": "where people are now and how they walk over the ground, both turned into the "
        "robot frame; the robot's own velocity is not subtracted",
        "order": f"the nearest {task.max_pedestrians} in view, near to far; where two overlap on "
        "the map, the later one is seen",
        "in_view": f"|x| and |y| at most {task.map_extent / 2.0:g} m, also behind the robot and "
        "behind walls; whoever is beyond is not drawn",
        "map_extent": task.map_extent,
        "map_cells": task.map_cells,
        "drawn_radius": task.pedestrian_radius,
    }


def _count(config: RunConfig) -> dict[str, Any]:
    return {
        "unit": "1",
        "meaning": "rows of people that are valid, from the first on; later rows are ignored",
        "least": 0,
        "most": config.task.max_pedestrians,
    }


def _goal(config: RunConfig) -> dict[str, Any]:
    values = goal_values(config)
    described: dict[str, Any] = {
        "columns": ["x", "y", "alpha", "var_x", "var_y", "var_yaw"][:values],
        "unit": ["m", "m", "rad", "m^2", "m^2", "rad^2"][:values],
        "frame": "robot, as estimated",
        "meaning": "the goal from where the robot believes itself to be; alpha is the goal's yaw "
        "minus the estimated yaw, in [-pi, pi), and in training the goal's yaw was that of the "
        "start",
    }
    if values > 3:
        described["variances"] = (
            "the diagonal of the pose estimate's covariance in the map frame, as AMCL publishes "
            f"it; raw, clipped inside to {config.task.variance_limit:g}, NaN as well"
        )
    return described


def _output(config: RunConfig, temperature: float) -> dict[str, Any]:
    drawn = "draw one as in training"
    if temperature != 1.0:
        drawn = f"temperature {temperature:g} is already in them, so draw one as they are"
    return {
        "name": OUTPUT,
        "dtype": "float32",
        "shape": [ROWS, len(action_table(config.task))],
        "unit": "1",
        "meaning": f"natural logarithms of the actions' probabilities; {drawn}, or take the "
        "likeliest",
    }


def _timing(config: RunConfig) -> dict[str, Any]:
    world, localization = config.world, config.localization
    period = world.tick * world.ticks_per_step
    return {
        "control_period": round(period, 9),
        "control_rate": round(1.0 / period, 9),
        "sensor_period": world.tick,
        "pose_age": round(localization.heard_delay * period, 9),
        "unit": {"control_rate": "Hz", "else": "s"},
        "meaning": "one decision per control period, whose velocities are held until the next; in "
        "training deciding took no time, scan and people were of the moment, and pose and "
        "variances behind the goal were pose_age old",
    }


def _task(config: RunConfig) -> dict[str, Any]:
    return {
        "arrive_distance": config.task.arrive_distance,
        "robot_radius": config.world.robot_radius,
        "time_limit": config.task.time_limit,
        "unit": {"time_limit": "s", "else": "m"},
        "meaning": "it has arrived where the estimated distance to the goal is below "
        "arrive_distance: stop there, the policy does not",
    }
