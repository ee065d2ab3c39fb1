"""The true world: robot, laser, crowd."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from lndrl.models import (
    LATER,
    Angle,
    Count,
    Model,
    NonNegative,
    Positive,
    PositiveAngle,
    Probability,
    Seconds,
)


class LaserConfig(Model):
    """Simulated laser with the beam range finder model (PAPER, Thrun et al. §6.3)."""

    beams: Count = Field(720, description="beams over the field of view (PAPER)")
    field_of_view: PositiveAngle = Field(3.141592653589793, description="rad, first beam at -fov/2")
    range_max: Positive = Field(12.0, description="m, the farthest reading (PAPER)")
    z_hit: Probability = Field(0.98, description="weight of a true reading (PAPER)")
    z_short: Probability = Field(0.0, description="unexpected objects; people are real (PAPER)")
    z_max: Probability = Field(0.01, description="weight of a missed echo (PAPER)")
    z_rand: Probability = Field(0.01, description="weight of a uniform reading (PAPER)")
    sigma_hit: NonNegative = Field(0.02, description="m, deviation of a true reading (PAPER)")
    lambda_short: Positive = Field(1.0, description="1/m, decay of z_short readings")

    @model_validator(mode="after")
    def _weights_sum_to_one(self) -> LaserConfig:
        total = self.z_hit + self.z_short + self.z_max + self.z_rand
        if abs(total - 1.0) > 1e-6:
            raise ValueError(f"z_hit + z_short + z_max + z_rand must be 1, not {total:g}")
        return self


class CrowdConfig(Model):
    """How pedestrians move (GROUP)."""

    max_speed: Positive = Field(0.5, description="m/s, the most that anybody walks (GROUP)")
    orca_neighbor_distance: Positive = Field(
        0.5, description="m within which ORCA minds others: a last-moment push (GROUP)"
    )
    orca_max_neighbors: Count = Field(10, description="nearest others that ORCA minds (GROUP)")
    orca_time_horizon: Seconds = Field(5.0, description="s ahead, collisions with others (GROUP)")
    orca_time_horizon_obstacle: Seconds = Field(
        5.0, description="s ahead, collisions with walls (GROUP)"
    )
    orca_radius: Positive = Field(0.5, description="m, of the disc that others avoid (GROUP)")
    orca_walls: bool = Field(
        True, description="ORCA people know the walls; the GROUP's did not and walked through them"
    )
    orca_wall_radius: Positive = Field(
        0.2, description="m kept to walls, the body's; orca_radius would close gaps below 1 m"
    )
    orca_veer: Angle = Field(
        0.5,
        le=1.5,
        description="rad to the right of the way while somebody is ahead within two radii: two "
        "who meet head-on pass instead of pushing each other; the GROUP's did not (0)",
    )
    sfm_desired: NonNegative = Field(1.0, description="weight of the desired force (libpedsim)")
    sfm_social: NonNegative = Field(2.1, description="weight of the force from others (libpedsim)")
    sfm_obstacle: NonNegative = Field(1.0, description="weight of the force from walls (libpedsim)")
    sfm_obstacle_sigma: Positive = Field(
        0.8, description="m in which the force from walls falls by e (libpedsim)"
    )
    sfm_radius: Positive = Field(0.2, description="m, of a body at walls (libpedsim)")
    sfm_lambda: Positive = Field(
        2.0, description="s/m, weight of relative velocity beside direction in the interaction D"
    )
    sfm_gamma: Positive = Field(0.35, description="m, range of the social force per length of D")
    sfm_n: Positive = Field(2.0, description="1/rad, how narrow the force is that turns aside")
    sfm_n_prime: Positive = Field(3.0, description="1/rad, how narrow the force is that slows down")
    sfm_cutoff: Positive = Field(8.0, description="m, farther neighbours are ignored")
    see_robot: bool = Field(True, description="pedestrians avoid the robot")
    leg_radius: Positive = Field(
        0.10, description="m, of a leg's disc: what is seen and hit (GROUP)"
    )
    leg_offset: NonNegative = Field(
        0.10, description="m from the middle to each leg, sideways (GROUP)"
    )
    step_length: Positive = Field(0.30, description="m walked per phase of the gait (GROUP)")
    waypoint_radius: Positive = Field(
        0.2, description="m within which a waypoint is reached (GROUP)"
    )
    model_period: Seconds = Field(
        0.4,
        description="s, step of the GROUP's crowd: ORCA resolves overlaps and SFM relaxes in it",
    )


class RandomizeConfig(Model):
    """What is drawn anew for every episode of training; tests have the settings as they are."""

    odometry_deviation: tuple[NonNegative, NonNegative] | None = Field(
        None,
        description="least and most of world.odometry_deviation, each value alike; null: as it is",
    )
    motion_noise: tuple[Positive, Positive] | None = Field(
        None,
        description="least and most factor on localization.odom_alpha1 to 4, each ratio alike; "
        "null: as they are",
    )

    @model_validator(mode="after")
    def _least_then_most(self) -> RandomizeConfig:
        for name in type(self).model_fields:
            between = getattr(self, name)
            if between is not None and between[0] > between[1]:
                raise ValueError(
                    f"{name} [{between[0]:g}, {between[1]:g}] must name the least first, then the "
                    "most"
                )
        return self


class RetryConfig(Model):
    """Second tries in training: an episode that failed goes back and is played on from there."""

    most: Annotated[int, Field(ge=0, le=1000)] = Field(
        0, description="second tries of an episode that failed, one after the other; 0: none"
    )
    back: tuple[Count, Count] = Field(
        (6, 30), description="least and most control steps that a try begins before the failure"
    )
    past: Count = Field(
        15, description="control steps after the moment of the failure at which a try is cut off"
    )
    every: Count = Field(4, description="control steps between the moments that are kept")

    @model_validator(mode="after")
    def _some_moment_is_kept(self) -> RetryConfig:
        least, most = self.back
        if most - least + 1 < self.every:
            raise ValueError(
                f"back [{least}, {most}] must span retry.every ({self.every}) control steps or "
                "more, least first; else there is not always a moment to go back to"
            )
        return self


class ReplicaConfig(Model):
    """Replicas of the robot's filter in training: other slip, other particles, the same drive."""

    count: Annotated[int, Field(ge=0, le=64)] = Field(
        0, description="filters that hear the drive beside the robot's own; 0: none"
    )
    lost: float = Field(
        0.0,
        description="paid if all of them got lost, a share of it for each that does, beside "
        "task.reward.lost for the robot's own: what getting lost costs on average, not by luck",
    )
    risk: float = Field(
        0.0,
        description="what getting lost costs, paid before it happens: in every step its chance, as "
        "far as errors of heading tell it, of the robot's own filter and of replicas together",
    )

    @model_validator(mode="after")
    def _somebody_gets_lost(self) -> ReplicaConfig:
        if self.lost != 0.0 and self.count == 0:
            raise ValueError(
                f"lost {self.lost:g} is paid for replicas, of which there are none; set "
                "replicas.count, e.g. to 4"
            )
        return self


ROBOT_PRESETS: dict[str, dict[str, Any]] = {
    # As the simulated robot of the paper's group is: velocities are what they are told to be.
    "immediate": {},
    # turtlebot_navigation's limits of a Kobuki base, from which its planner plans.
    "turtlebot2": {"acceleration": {"linear": 1.0, "angular": 2.0}},
}


class AccelerationConfig(Model):
    """How fast the robot's velocities can change; without any limit a command holds at once."""

    linear: Positive | None = Field(
        None, description="m/s², most by which it gains speed, forward or backward; null: no limit"
    )
    braking: Positive | None = Field(
        None, description="m/s², most by which it loses speed; null: as linear"
    )
    angular: Positive | None = Field(
        None, description="rad/s², most by which its rate of turning changes; null: no limit"
    )

    @property
    def limits(self) -> tuple[float, float, float]:
        """m/s² of gaining and of losing speed, rad/s²; infinite where there is no limit."""
        gain, turn = (math.inf if v is None else float(v) for v in (self.linear, self.angular))
        return gain, gain if self.braking is None else float(self.braking), turn


class RobotConfig(Model):
    """What the robot's base can do.

    In YAML either a preset's name (``robot: turtlebot2``) or keys.
    """

    preset: Literal["immediate", "turtlebot2"] = Field(
        "immediate", description="immediate, turtlebot2: values of the keys that are not named"
    )
    acceleration: AccelerationConfig = Field(
        AccelerationConfig(), description="limits on acceleration; none by default (PAPER)"
    )

    @model_validator(mode="before")
    @classmethod
    def _resolve(cls, data: Any) -> Any:
        """A preset's name, alone or as key, to the keys that it stands for."""
        if isinstance(data, str):
            data = {"preset": data}
        if not isinstance(data, dict) or not isinstance(data.get("preset"), str):
            return data
        name = data["preset"]
        if name not in ROBOT_PRESETS:
            raise ValueError(f"preset {name!r} is unknown; known: {', '.join(ROBOT_PRESETS)}")
        return {**ROBOT_PRESETS[name], **data}


class WorldConfig(Model):
    """The true world: clock, robot, sensors, crowd."""

    tick: Seconds = Field(0.1, description="s between sensor and localization updates (10 Hz)")
    ticks_per_step: Count = Field(4, description="ticks per control step: 0.4 s (GROUP)")
    robot_radius: Positive = Field(0.17, description="m, of the robot's disc (GROUP)")
    odometry_deviation: NonNegative = Field(
        0.1, description="deviation of the factor on v and on w; N(1, 0.01) is a variance (PAPER)"
    )
    odometry_draw: Annotated[Literal["step", "reading"], LATER] = Field(
        "step",
        description="the two factors are drawn for every control step, or for every odometry "
        "reading, which is every tick: the paper's words can be read both ways",
    )
    robot: Annotated[RobotConfig, LATER] = Field(
        RobotConfig(), description="what its base can do: a preset's name, or keys"
    )
    laser: LaserConfig = Field(LaserConfig(), description="the laser and its noise")
    crowd: CrowdConfig = Field(CrowdConfig(), description="how people walk")
