"""What is measured how long: on a GPU, and in a rehearsal of the same on the CPU in small."""

from __future__ import annotations

from dataclasses import dataclass

from lndrl.bench.scene import hybrid_config
from lndrl.config import RunConfig
from lndrl.machine.cores import usable_cores

PRECISIONS = ("float32", "bfloat16")
WAYS = {"no_graphs": False, "graphs": True}
"""Without CUDA graphs first: those work wherever anything does."""

_SMALL = (
    "scenario=sparse",
    "network.map_channels=[2,2,2]",
    "network.features=4",
    "network.goal_features=2",
    "ppo.batch_size=64",
    "ppo.minibatch_size=64",
    "actor.worlds=2",
    "actor.horizon=16",
    "localization.min_particles=50",
    "localization.max_particles=100",
    "learner.threads=1",
)


@dataclass(frozen=True)
class Plan:
    """How the parts measure.

    device: as torch calls it. minutes: of all parts together, unless asked otherwise. seconds:
    timed per figure of policy and learner. observations: different ones that the policy sees.
    batches, minibatches: samples. matrix: side of the product that the card is tried with. actors:
    of the timed trainings. timed: s of updates of each. target: share of arrivals. validation:
    settings of the run that is trained until ``target``. settings: of every configuration. least:
    factor on what parts need to begin.
    """

    device: str
    minutes: float
    seconds: float
    observations: int
    batches: tuple[int, ...]
    minibatches: tuple[int, ...]
    matrix: int
    actors: int
    timed: float
    target: float
    validation: tuple[str, ...]
    settings: tuple[str, ...] = ()
    least: float = 1.0

    @property
    def is_rehearsal(self) -> bool:
        """Whether nothing of it says anything of a GPU."""
        return self.device == "cpu"

    def config(self, *overrides: str) -> RunConfig:
        """``configs/lndrl.yaml`` on hybrid, on the device, but for ``overrides`` (key=value)."""
        return hybrid_config([f"learner.device={self.device}", *self.settings, *overrides])


def full_plan() -> Plan:
    """For a machine with a GPU."""
    return Plan(
        device="cuda",
        minutes=8.0,
        seconds=1.0,
        observations=1024,
        batches=(64, 512, 4096),
        minibatches=(256, 2048),
        matrix=8192,
        actors=usable_cores(),
        timed=20.0,
        target=0.75,
        # An evaluator that rested would say later that it is reached.
        validation=("learner.validation_share=1.0",),
    )


def rehearsal() -> Plan:
    """The same script on the CPU: small networks, few samples, a target that is reached at once."""
    return Plan(
        device="cpu",
        minutes=5.0,
        seconds=0.1,
        observations=64,
        batches=(4, 16),
        minibatches=(32, 64),
        matrix=128,
        actors=1,
        timed=2.0,
        target=0.0,
        validation=("learner.validation_share=1.0", "learner.validation_episodes=2"),
        settings=_SMALL,
        least=0.5,
    )
