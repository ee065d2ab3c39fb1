"""Where a run with a teacher stands: imitating, guided by it, or on its own."""

from __future__ import annotations

from dataclasses import dataclass

from lndrl.config import RunConfig
from lndrl.policy import Guidance
from lndrl.transport.status import GUIDED, IMITATION, REINFORCEMENT


@dataclass(frozen=True)
class Stage:
    """What holds at one moment of a run; the default is a run without a teacher.

    temperature: of the softmax over the teacher's costs. kl: weight of KL(teacher || policy) in
    PPO's loss. drives: share of worlds that the teacher drives. until: steps at which the phase
    ends; None for the last one. learning_rate: of the policy, where it is not PPO's. avoids: the
    teacher goes on to say what is dangerous.
    """

    phase: str = REINFORCEMENT
    temperature: float = 1.0
    kl: float = 0.0
    drives: float = 0.0
    learning_rate: float | None = None
    avoids: bool = False
    until: int | None = None

    @property
    def guidance(self) -> Guidance:
        """What actors are told."""
        return Guidance(labels=self.phase != REINFORCEMENT or self.avoids, drives=self.drives)

    def words(self, config: RunConfig) -> str:
        """What begins with this stage, for the log."""
        end = f" until step {self.until:,}" if self.until else ""
        if self.phase == IMITATION:
            return f"imitation of {config.ppo.teacher}{end}"
        if self.phase == GUIDED:
            return f"PPO, held to {config.ppo.teacher} by a divergence that fades{end}"
        return "PPO"


def stage_of(config: RunConfig, steps: int) -> Stage:
    """The stage of a run of ``config`` after so many environment ``steps``."""
    plan = config.imitation
    if config.ppo.teacher is None:
        return Stage()
    if steps < plan.steps:
        done = steps / plan.steps
        return Stage(
            IMITATION,
            plan.temperature + done * (plan.final_temperature - plan.temperature),
            drives=max(0.0, 1.0 - steps / plan.drive_steps) if plan.drive_steps else 0.0,
            learning_rate=plan.learning_rate
            + done * (plan.final_learning_rate - plan.learning_rate),
            until=plan.steps,
        )
    since, end = steps - plan.steps, plan.steps + plan.kl_steps
    if steps < end and plan.kl > 0.0:
        kl = plan.kl * (1.0 - since / plan.kl_steps)
        return Stage(GUIDED, plan.final_temperature, kl, avoids=plan.avoid > 0.0, until=end)
    return Stage(temperature=plan.final_temperature, avoids=plan.avoid > 0.0)
