"""Learning by example: how long, from what, and how the example fades."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from lndrl.extensions import PartSettings
from lndrl.models import LATER, MOST, Count, Model, NonNegative, Positive, Probability


class ImitationConfig(Model):
    """What ``ppo.teacher`` is used for; without one nothing of it matters.

    First the policy only imitates, from all states that it has met so far (Ross et al. 2011,
    "A reduction of imitation learning and structured prediction to no-regret online learning");
    then PPO takes over, held to the teacher by a KL divergence that fades.
    """

    steps: Count = Field(40_960, description="environment steps in which the policy only imitates")
    drive_steps: Annotated[int, Field(ge=0, le=MOST)] = Field(
        8_192,
        description="of these, the first in which the teacher drives, too: its share falls from 1 "
        "to 0, by then the policy meets its own mistakes",
    )
    passes: Positive = Field(
        4.0, description="states that the policy is trained on per state that comes in"
    )
    memory: Count = Field(
        100_000, description="newest states that are imitated; about 1.9 kB each in the learner"
    )
    temperature: Positive = Field(
        0.4, ge=0.001, description="of the softmax over the teacher's costs, at first"
    )
    final_temperature: Positive = Field(
        0.1, ge=0.001, description="the same at the end of imitation, and from then on"
    )
    regret: Annotated[NonNegative, LATER] = Field(
        0.0,
        description="weight, beside the divergence from the teacher, of what the policy's actions "
        "cost above the cheapest: not how likely a wrong one is, but how wrong",
    )
    mirror: bool = Field(
        True, description="half of the states are imitated as their mirror images, left for right"
    )
    vary: Annotated[Probability, LATER] = Field(
        0.0,
        description="share of the states that are imitated with goal, people and belief moved a "
        "little, and labelled anew by the learner: none is learned by heart",
    )
    learning_rate: Positive = Field(1.0e-3, description="Adam's step of the policy, at first")
    final_learning_rate: Positive = Field(
        1.0e-4, description="the same at the end of imitation; linear in between"
    )
    kl: NonNegative = Field(
        1.0, description="weight of KL(teacher || policy) in PPO's loss where imitation ends"
    )
    kl_steps: Annotated[int, Field(ge=0, le=MOST)] = Field(
        100_000, description="environment steps after that in which the weight falls to 0"
    )
    avoid: Annotated[NonNegative, LATER] = Field(
        0.0,
        description="weight in PPO's loss, to the end, of the chance that the policy takes an "
        "action which the teacher deems dangerous: what it saw of collisions is not forgotten",
    )
    danger: Annotated[Positive, LATER] = Field(
        50.0, description="teacher's cost above the cheapest from which an action is dangerous"
    )
    settings: PartSettings = Field(
        default_factory=dict, description="parameters of the teacher, as --planner-set takes them"
    )

    @model_validator(mode="after")
    def _driven_while_imitating(self) -> Self:
        if self.drive_steps > self.steps:
            raise ValueError(
                f"imitation.drive_steps {self.drive_steps:,} must not exceed imitation.steps "
                f"({self.steps:,}): PPO learns from the policy's own actions"
            )
        return self
