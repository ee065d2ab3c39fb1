"""Networks, PPO, and the services that train."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from lndrl.extensions import PartName, PartSettings
from lndrl.models import LATER, MOST, Count, Model, NonNegative, Positive, Probability, Seconds

BUILT_IN = "lndrl"
SCAN_ENCODERS = (BUILT_IN, "fan")
"""Built-in scan encoders; the built-in network and map encoder are called BUILT_IN alone."""

MOST_WORLDS_PER_ACTOR = 4096
"""A learner takes no chunk of more."""
MOST_ACTORS = 2048
"""A learner remembers no more."""
Threads = Annotated[int, Field(ge=0, le=4096)]


class NetworkConfig(Model):
    """The paper's encoders, trunk and head (PAPER §III-B, pooling GROUP)."""

    policy: Annotated[PartName, LATER] = Field(
        BUILT_IN,
        description="lndrl, or a class of your own for both networks (docs/extend/network.md)",
    )
    policy_settings: Annotated[PartSettings, LATER] = Field(
        default_factory=dict, description="keyword arguments of a class of your own"
    )

    pooling: Literal["max", "none"] = Field("max", description="2x2 after each map convolution")
    map_channels: tuple[int, int, int] = Field(
        (64, 128, 256), description="of the three convolutions over the pedestrian map (PAPER)"
    )
    scan_encoder: PartName = Field(
        BUILT_IN,
        description="lndrl: the paper's; fan: that of DRL_laser for several scans (§7.1); or a "
        "class of your own (docs/extend/encoder.md)",
    )
    scan_encoder_settings: Annotated[PartSettings, LATER] = Field(
        default_factory=dict, description="keyword arguments of a class of your own"
    )
    map_encoder: Annotated[PartName, LATER] = Field(
        BUILT_IN, description="of the pedestrian map: lndrl, or a class of your own"
    )
    map_encoder_settings: Annotated[PartSettings, LATER] = Field(
        default_factory=dict, description="keyword arguments of a class of your own"
    )
    pedestrian_map: bool = Field(True, description="False: people are seen in the scan alone")
    variances: bool = Field(True, description="False: the goal without the belief's variances")
    features: Count = Field(512, description="units of map encoder, scan encoder, trunk (PAPER)")
    goal_features: Count = Field(64, description="units of the goal's encoder (PAPER)")
    layer_norm: Annotated[bool, LATER] = Field(
        False, description="normalize the trunk's units before their ReLU, in both networks"
    )
    initialization: Literal["orthogonal", "default"] = Field(
        "orthogonal", description="orthogonal with a small policy head, or torch's default (GROUP)"
    )
    variance_scale: Positive = Field(
        1.0, description="factor on the belief's variances (m², rad²) where the networks read them"
    )
    turn_reluctance: NonNegative = Field(
        0.0, description="the first policy's logits fall by this per rad/s; wheels slip in turns"
    )

    @model_validator(mode="after")
    def _settings_have_a_class(self) -> NetworkConfig:
        for part, builtin in (
            ("policy", (BUILT_IN,)),
            ("scan_encoder", SCAN_ENCODERS),
            ("map_encoder", (BUILT_IN,)),
        ):
            if getattr(self, f"{part}_settings") and getattr(self, part) in builtin:
                raise ValueError(
                    f"{part}_settings go to a class of your own; {part} is the built-in "
                    f"{getattr(self, part)}"
                )
        if self.layer_norm and self.policy != BUILT_IN:
            raise ValueError(
                f"layer_norm is of the built-in network's trunk; policy is {self.policy}, which "
                "normalizes for itself"
            )
        return self


class PPOConfig(Model):
    """Proximal policy optimization."""

    actor_learning_rate: Positive = Field(3e-4, description="Adam's step, policy (GROUP 5e-5)")
    critic_learning_rate: Positive = Field(3e-4, description="Adam's step, value (GROUP 1e-3)")
    learning_rate_schedule: Literal["constant", "linear"] = Field(
        "linear", description="linear: to 0 over learner.total_steps (GROUP constant)"
    )
    gamma: Probability = Field(0.99, description="discount per control step (GROUP)")
    gae_lambda: Probability = Field(
        0.95, description="decay of later errors in generalized advantage estimation (GROUP)"
    )
    clip: Positive = Field(
        0.2, description="a ratio of probabilities farther from 1 gains nothing more (GROUP)"
    )
    dual_clip: float | None = Field(
        None,
        gt=1,
        description="where an advantage is negative, the objective is at least this times it "
        "(Ye et al. 2020; GROUP 3)",
    )
    epochs: Count = Field(4, description="passes over a batch (GROUP 10)")
    batch_size: Count = Field(1024, description="samples per update, at least (GROUP)")
    batch_size_final: Annotated[Count | None, LATER] = Field(
        None,
        description="samples per update in the end: batch_size doubles up to it at equal distances "
        "in learner.total_steps, the minibatch stays; null: batches do not grow",
    )
    minibatch_size: Count | None = Field(
        256, description="samples per gradient step; null: the whole batch (GROUP)"
    )
    entropy: NonNegative = Field(0.01, description="weight of the policy's entropy (GROUP 0)")
    entropy_final: Annotated[NonNegative | None, LATER] = Field(
        None, description="entropy's weight after learner.total_steps, on a line; null: it stays"
    )
    value_loss: Positive = Field(
        0.5, description="weight of the value's mean squared error (GROUP)"
    )
    gradient_norm: Positive = Field(
        0.5, description="gradients are cut to it, actor and critic apart (GROUP)"
    )
    joint_gradient_norm: bool = Field(False, description="one norm over both nets (GROUP)")
    normalize_advantages: bool = Field(
        True, description="to mean 0 and deviation 1 over a batch (GROUP false)"
    )
    target_kl: Positive | None = Field(
        None, description="epochs of the policy end where the KL divergence is above (GROUP none)"
    )
    reward_scale: Positive = Field(0.01, description="factor on rewards inside the learner")
    reward_limit: Positive | None = Field(
        None, description="scaled rewards, clipped to +- this; a belief that jumps costs k_p per m"
    )
    way_value: Annotated[bool, LATER] = Field(
        False,
        description="values are the value network's plus what the way to the goal pays, "
        "task.reward.approach per metre: the network learns only what comes beside; for a gamma "
        "near 1",
    )
    bootstrap_truncated: bool = Field(True, description="else a timeout is an end (GROUP)")
    max_importance: Positive = Field(
        10.0, description="most that an older policy's sample is weighted"
    )
    adam_eps: Positive = Field(1e-5, description="Adam's epsilon in the denominator (GROUP 1e-8)")
    teacher: Annotated[Literal["predictive", "careful"] | None, LATER] = Field(
        None,
        description="planner that the policy learns from by example first, see imitation; null: "
        "by reward alone",
    )

    @model_validator(mode="after")
    def _batches_grow(self) -> PPOConfig:
        if self.batch_size_final is not None and self.batch_size_final < self.batch_size:
            raise ValueError(
                f"batch_size_final {self.batch_size_final} must be batch_size {self.batch_size} or "
                "more; batches grow"
            )
        return self


class LearnerConfig(Model):
    """The learner service."""

    mode: Literal["async", "lockstep"] = Field(
        "async",
        description="lockstep: actors wait for the weights before the newest, and a run repeats; "
        "async: they go on with what they have",
    )
    max_lag: Annotated[int, Field(ge=0, le=MOST)] = Field(
        8, description="weight versions; samples that are older are dropped"
    )
    total_steps: Count = Field(1_200_000, description="environment steps (PAPER)")
    threads: Threads = Field(0, description="threads of the networks' torch, 0: all cores")
    device: str = Field("cpu", description="cpu, cuda, cuda:N, or auto: a GPU where there is one")
    precision: Literal["auto", "float32", "bfloat16"] = Field(
        "auto",
        description="of the products in the networks; weights stay float32. auto: bfloat16 on GPUs",
    )
    privileged_critic: Annotated[bool, LATER] = Field(
        False,
        description="the value network alone also sees what only the simulator knows: the belief's "
        "true error, its clusters, people outside of the view (docs/training.md); actors send it",
    )
    cuda_graphs: bool = Field(True, description="replay gradient steps on GPUs as CUDA graphs")
    start: str | None = Field(
        None,
        description="folder of a run whose newest networks and optimizers this one begins with, or "
        "of one of its checkpoints; a policy file, or shipped, gives the policy alone",
    )
    average: Annotated[float, Field(ge=0, lt=1), LATER] = Field(
        0.0,
        description="decay per update of the policy's averaged weights, which are then what a "
        "checkpoint's policy file holds and what is tested, e.g. 0.95; 0: no average",
    )
    acting: Annotated[Literal["current", "average"], LATER] = Field(
        "current", description="weights that actors act on; average needs learner.average above 0"
    )
    checkpoint_interval: Count = Field(20, description="updates between checkpoints")
    keep_checkpoints: Count = Field(3, description="newest checkpoints that are kept")
    validation_episodes: Annotated[int, Field(ge=0, le=100_000), LATER] = Field(
        0,
        description="episodes that an evaluator plays again and again with the newest weights, "
        "sampled and greedy; 0: none (docs/training.md)",
    )
    validation_share: Annotated[float, Field(gt=0.0, le=1.0), LATER] = Field(
        0.15, description="of one core's time that an evaluator takes on average"
    )
    patience: Annotated[int, Field(ge=0, le=MOST), LATER] = Field(
        0,
        description="environment steps after which a run is finished, before total_steps, where "
        "its validated arrivals have not risen; counted from the best or from the end of "
        "imitation, whichever is later; 0: never (docs/training.md)",
    )
    queue_chunks: Count = Field(64, description="uploads waiting at most")
    queue_megabytes: Count = Field(512, description="10^6 bytes of uploads waiting at most")

    @field_validator("device")
    @classmethod
    def _known_device(cls, device: str) -> str:
        if not re.fullmatch(r"auto|cpu|cuda(:\d+)?", device):
            raise ValueError(f"{device} is not a device; write cpu, cuda, cuda:0 or auto")
        return device

    @model_validator(mode="after")
    def _arrivals_to_wait_for(self) -> LearnerConfig:
        if self.patience and not self.validation_episodes:
            raise ValueError(
                "patience goes by validated arrivals; it needs validation_episodes above 0, e.g. "
                "validation_episodes: 100"
            )
        return self

    @model_validator(mode="after")
    def _an_average_to_act_on(self) -> LearnerConfig:
        if self.acting == "average" and not self.average:
            raise ValueError("acting: average needs average above 0, e.g. average: 0.95")
        return self


def _auto_or_up_to(most: int) -> BeforeValidator:
    def check(value: Any) -> Any:
        whole = isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most
        if value != "auto" and not whole:
            raise ValueError(f"{value!r} must be auto or a whole number from 1 to {most}")
        return value

    return BeforeValidator(check)


ActorsOrAuto = Annotated[int | Literal["auto"], _auto_or_up_to(MOST_ACTORS)]
WorldsOrAuto = Annotated[int | Literal["auto"], _auto_or_up_to(MOST_WORLDS_PER_ACTOR)]


class ActorConfig(Model):
    """The actor service."""

    count: ActorsOrAuto = Field(
        "auto",
        description="processes that lndrl train starts; auto: as the machine and the learner's "
        "waiting say, but 2 where a run must repeat on every machine (--serial, lockstep)",
    )
    worlds: WorldsOrAuto = Field(
        "auto",
        description="worlds per process; auto: as many as keep chunks small beside a batch, see "
        "RunConfig.worlds_per_actor",
    )
    horizon: Count = Field(64, description="steps per chunk")
    threads: Threads = Field(1, ge=1, description="threads of matrix products per actor")
    precision: Literal["float32", "bfloat16"] = Field(
        "float32", description="of the policy's products; bfloat16 pays where there is hardware"
    )


class TransportConfig(Model):
    """Zenoh between learner, actors and dashboards."""

    endpoint: str = Field(
        "tcp/127.0.0.1:7447",
        description="where the learner listens: tcp/HOST:PORT or tls/HOST:PORT",
    )
    router: bool = Field(
        False, description="endpoint is a zenoh router that the learner joins instead of listening"
    )
    namespace: str = Field("", description="before every key, so that runs can share a router")
    upload_timeout: Seconds = Field(20.0, description="s until an upload is sent again")
    upload_window: Annotated[int, Field(ge=1, le=16)] = Field(
        2, description="uploads in flight per actor; a learner tells apart 16 that overtake"
    )
    lease: Seconds = Field(3.0, description="s until a silent peer counts as gone")
    weights: Annotated[Literal["float32", "float16"], LATER] = Field(
        "float32",
        description="as weights travel to actors; float16: half the bytes, rounded to 11 binary "
        "digits, by which samples are corrected (docs/ranks.md). Checkpoints stay float32",
    )
    max_message_megabytes: Annotated[int, Field(ge=1, le=512)] = Field(
        256, description="MiB that a chunk or the weights may have; what is larger is not received"
    )

    @field_validator("namespace")
    @classmethod
    def _plain_namespace(cls, namespace: str) -> str:
        word = r"[A-Za-z0-9_][A-Za-z0-9_.\-]*"
        if not re.fullmatch(rf"({word}(/{word})*)?", namespace):
            raise ValueError(
                f"{namespace!r} is not a namespace; write letters, digits, _ . and -, e.g. lab/run1"
            )
        return namespace
