"""What the robot sees, does and is paid for."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from lndrl.extensions import PartName, PartSettings
from lndrl.models import (
    LATER,
    Count,
    Later,
    Model,
    Positive,
    PositiveAngle,
    Seconds,
    as_recorded,
)

_TERM_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
MOST_TERMS = 16


class RewardTerm(Model):
    """A summand of the reward that is a class of your own (docs/extend/reward.md)."""

    use: PartName = Field(description="module:Class, or an installed reward term's name")
    weight: float = Field(1.0, description="factor on what the class pays")
    settings: PartSettings = Field(
        default_factory=dict, description="keyword arguments of the class"
    )


class RewardConfig(Model):
    """The six-part reward (PAPER §III-A3)."""

    approach: float = Field(
        200.0, description="k_a, per metre nearer to the goal, over 1 + variances"
    )
    pose: float = Field(400.0, description="k_p, per metre or radian of pose error reduced")
    arrive: float = Field(500.0, description="r_arr, when it arrives")
    collide: float = Field(-800.0, description="r_col, when it hits something")
    lost: float = Field(-500.0, description="r_lost, when truth and estimate are too far apart")
    step: float = Field(-5.0, description="r_step, every step; '<' in the paper is a typo")
    pose_limit: Annotated[Positive | None, LATER] = Field(
        None,
        description="most that the pose part pays or costs: a pose error above pose_limit / pose "
        "counts as that much; in training only; null: as published, a jump costs k_p per metre",
    )
    terms: Annotated[dict[str, RewardTerm], LATER] = Field(
        default_factory=dict,
        max_length=MOST_TERMS,
        description="further summands by name, classes of your own; in training only",
    )

    @field_validator("terms")
    @classmethod
    def _names_of_their_own(cls, terms: dict[str, RewardTerm]) -> dict[str, RewardTerm]:
        for name in terms:
            if not _TERM_NAME.fullmatch(name):
                raise ValueError(
                    f"{name!r} must be a name of small letters, digits and '_', at most 32"
                )
            if name in cls.model_fields:
                raise ValueError(f"{name} is a part of the reward already; choose another name")
        return terms


class TaskConfig(Model):
    """What the robot sees, does, and is paid for."""

    linear_velocities: list[float] = Field(
        [0.0, 0.2, 0.4, 0.6], min_length=1, max_length=16, description="m/s to choose from (PAPER)"
    )
    angular_velocities: list[float] = Field(
        [-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9],
        min_length=1,
        max_length=16,
        description="rad/s to choose from (PAPER); an action is one byte on the wire",
    )
    arrive_distance: Positive = Field(0.5, description="m, estimate to goal: arrived (PAPER)")
    lost_distance: Positive = Field(2.0, description="m, truth to estimate: lost (PAPER)")
    lost_angle: PositiveAngle = Field(
        0.7853981633974483, description="rad, truth to estimate: lost; pi/4 (PAPER)"
    )
    judged_moment: Annotated[Literal["report", "present"], Later("present")] = Field(
        "report",
        description="where localization.delay makes reports old: the pose error that is paid for, "
        "and that ends an episode as lost, compares a report with the truth of the moment that it "
        "describes, or with the present truth, which charges every turn for being heard late",
    )
    time_limit: Seconds = Field(60.0, description="s, then an episode is truncated (GROUP)")
    scan_frames: Annotated[int, Field(ge=1, le=8)] = Field(
        1, description="scans of consecutive control steps that are seen together (Fan et al. 2020)"
    )
    map_cells: Count = Field(48, description="cells per side of the pedestrian map (PAPER)")
    map_extent: Positive = Field(6.0, description="m per side of the pedestrian map (GROUP)")
    pedestrian_radius: Positive = Field(0.30, description="m, disc drawn per pedestrian (GROUP)")
    max_pedestrians: Count = Field(
        24, le=255, description="nearest people in view that are kept; one byte on the wire"
    )
    variance_limit: Positive = Field(
        10.0, description="m^2 and rad^2 at which variances are clipped (ours)"
    )
    reward: RewardConfig = Field(RewardConfig(), description="what it is paid (PAPER §III-A3)")

    @model_validator(mode="before")
    @classmethod
    def _recorded(cls, data: Any) -> Any:
        return as_recorded(cls, data)
