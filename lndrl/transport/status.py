"""The learner's status snapshot and its history, as every viewer reads them.

Viewers and learners may be of different versions, so unknown keys are ignored and most keys have
a default; values that no learner can mean (negative counts, rates above 1, text for numbers) are
refused.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field

from lndrl.errors import UserError
from lndrl.models import Model, validate


def _nan_is_missing(value: Any) -> Any:
    return None if isinstance(value, float) and math.isnan(value) else value


Count = Annotated[int, Field(ge=0)]
Amount = Annotated[float, Field(ge=0)]
"""A finite number that is never negative."""
Share = Annotated[float, Field(ge=0, le=1.0 + 1e-6)]
Measured = Annotated[float | None, BeforeValidator(_nan_is_missing)]
"""A mean that does not exist before the first sample: None, or NaN on the wire."""
MeasuredShare = Annotated[Share | None, BeforeValidator(_nan_is_missing)]


LEARNER_ACTIVITIES = ("update", "ingest", "publish", "checkpoint", "wait", "other")
"""Where a learner's time goes. ``wait`` is for data; ``other`` records, and is all the rest."""
ACTOR_ACTIVITIES = ("simulate", "infer", "upload", "fetch", "wait", "other")
"""Where an actor's time goes. ``upload`` packs and hands over, ``fetch`` gets and loads weights,
``wait`` is for room at the learner or for weights, ``other`` is the loop around it all."""
IMITATION, GUIDED, REINFORCEMENT = "imitation", "guided", "reinforcement"
"""What a policy is trained by: a teacher's costs alone; PPO, held to the teacher; PPO."""
WORK = frozenset({"update", "simulate", "infer"})
"""What a busy process is there for; its other time is overhead."""

LEARNER_WAITS = 0.1
"""Share of waiting from which a learner could use more actors."""
ACTORS_IDLE = 0.6
"""Share of waiting from which there are more actors than the learner can follow."""


def shares_of(seconds: Mapping[str, float]) -> dict[str, float]:
    """Seconds by activity as shares of their sum; empty where nothing took time."""
    total = sum(seconds.values())
    return {name: value / total for name, value in seconds.items()} if total > 0 else {}


def overhead(seconds: Mapping[str, float]) -> float | None:
    """Share of the time that is not waiting and yet no WORK; None where all was waiting.

    ``seconds`` by activity, of an actor or of a learner; shares do as well.
    """
    busy = sum(seconds.values()) - seconds.get("wait", 0.0)
    work = sum(value for name, value in seconds.items() if name in WORK)
    return min(1.0, max(0.0, 1.0 - work / busy)) if busy > 1e-9 else None


def balance_word(learner_waits: float, actors_idle: float) -> str:
    """The verdict on two shares of waiting: actor-bound, learner-bound or balanced."""
    if learner_waits > LEARNER_WAITS:
        return "actor-bound"
    return "learner-bound" if actors_idle > ACTORS_IDLE else "balanced"


class StatusModel(Model):
    """Frozen like every model, but keys of newer versions are ignored."""

    model_config = ConfigDict(extra="ignore", populate_by_name=True)


MOST_LAG = 15
"""Versions from which on all lags count as one in ``Lag.shares`` and ``Session.lags``."""
UPLOAD_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
"""Bounds of ``Traffic.waits``, each the longest of its class."""


class Machine(StatusModel):
    """How busy a machine is; nothing known: 0 cores."""

    cpu: Share = 0.0
    memory: Share = 0.0
    cores: Amount = 0.0
    gigabytes: Amount = Field(0.0, description="memory in 2^30 bytes")
    gpus: Amount = Field(0.0, description="that it has; 0 where none is known")
    gpu: Share = Field(0.0, description="of the time, mean over its GPUs")
    gpu_memory: Share = Field(0.0, description="of all its GPUs together")


class Rate(StatusModel):
    """Environment steps per second over the last 10, 60 and 300 s."""

    seconds_10: Amount = Field(0.0, alias="10s")
    seconds_60: Amount = Field(0.0, alias="60s")
    seconds_300: Amount = Field(0.0, alias="300s")


class ActorStatus(StatusModel):
    """One actor process as the learner sees it."""

    id: str
    host: str = ""
    pid: Count = 0
    worlds: Count = 0
    state: str = Field("active", description="active, slow or gone")
    last_ack_age: Amount | None = Field(None, description="s since its last acknowledged chunk")
    gone_for: Amount | None = Field(None, description="s since it has gone; None while here")
    kernels_ready: Count = Field(0, description="while it compiles: kernels that it has")
    kernels_needed: Count = Field(0, description="of so many that it needs; 0 once it has begun")
    lag: Count = Field(0, description="weights versions behind the learner")
    steps: Count = 0
    rate: Amount = Field(0.0, description="steps/s")
    restarts: Count = 0
    time_split: dict[str, Share] = Field(default_factory=dict)
    machine: Machine = Machine()


class Episodes(StatusModel):
    """Outcomes of the last ``window`` episodes; ``count`` episodes in all."""

    count: Count = 0
    window: Count = 0
    arrived: MeasuredShare = None
    collided: MeasuredShare = None
    lost: MeasuredShare = None
    timeout: MeasuredShare = None
    mean_return: Measured = None
    mean_time: Measured = Field(None, description="s")
    mean_distance: Measured = Field(None, description="m")
    position_error: Measured = Field(None, description="m")


class Optimization(StatusModel):
    """The newest PPO update. NaN and infinity stay: they are what a viewer must show."""

    model_config = ConfigDict(allow_inf_nan=True)

    policy_loss: float | None = None
    value_loss: float | None = None
    entropy: float | None = None
    kl: float | None = None
    clip_fraction: float | None = None
    explained_variance: float | None = None
    gradient_norm_policy: float | None = None
    gradient_norm_value: float | None = None
    learning_rate: float | None = None
    importance_max: float | None = None
    teacher_kl: float | None = Field(None, description="KL(teacher || policy)")
    teacher_agreement: float | None = Field(
        None, description="share of states where both like the same action best"
    )


class Lag(StatusModel):
    """Weights versions between the acting and the learning policy, over the last update."""

    mean: Measured = None
    max: Count | None = None
    shares: list[Share] = Field(default_factory=list, description="of samples, by lag from 0 on")


class Dropped(StatusModel):
    """Chunks that were not learned from: acknowledged ones by rule, others by answer."""

    stale: Count = Field(0, description="older than learner.max_lag versions")
    restart: Count = Field(0, description="the learner died before a checkpoint held them")
    end: Count = Field(0, description="waiting when the run stopped")
    diverged: Count = Field(0, description="made an update non-finite")
    duplicate: Count = 0
    refused: Count = 0
    pause: Count = 0


class Tally(StatusModel):
    """Chunks, and the samples in them."""

    chunks: Count = 0
    samples: Count = 0


class Accounts(StatusModel):
    """What became of all that was acknowledged: accepted = trained + dropped + waiting."""

    accepted: Tally = Tally()
    trained: Tally = Tally()
    waiting: Tally = Tally()
    dropped: dict[str, Tally] = Field(default_factory=dict, description="by rule")


class Queue(StatusModel):
    """Chunks that wait for the learner."""

    chunks: Count = 0
    megabytes: Amount = 0.0


class Event(StatusModel):
    """One line of the log."""

    time: Amount
    kind: str = ""
    text: str = ""


class Checkpoint(StatusModel):
    """The newest checkpoint."""

    path: str = ""
    age: Amount | None = Field(None, description="s")


class Counts(StatusModel):
    """How validation episodes ended."""

    episodes: Count = 0
    arrived: Count = 0
    collided: Count = 0
    lost: Count = 0
    timeout: Count = 0
    steps: Count = 0


class Validated(StatusModel):
    """What an evaluator found of the weights after so many ``steps``."""

    version: Count = 0
    steps: Count = 0
    unix: Amount = Field(0.0, description="unix s when it was told")
    sampled: Counts = Counts()
    greedy: Counts = Counts()


class ValidationStatus(StatusModel):
    """The validated curve, as long as a run validates."""

    episodes: Count = Field(0, description="of a round, sampled and greedy each")
    heard: Amount | None = Field(None, description="s since an evaluator was last heard")
    points: list[Validated] = Field(default_factory=list, description="newest last")
    best: Validated | None = Field(None, description="whose policy is kept as checkpoints/best")


class Session(StatusModel):
    """Counts since this learner started; unlike a run's, they never go back to a checkpoint."""

    started: Amount = Field(0.0, description="unix s")
    steps: Count = Field(0, description="trained on")
    updates: Count = 0
    episodes: dict[str, Count] = Field(default_factory=dict, description="by outcome")
    lags: list[Count] = Field(default_factory=list, description="samples by lag from 0 on")
    lag_sum: Count = Field(0, description="of all samples' lags, in versions")


class Traffic(StatusModel):
    """What went through the learner's door since it started."""

    answers: dict[str, Count] = Field(default_factory=dict, description="uploads by answer")
    waits: list[Count] = Field(
        default_factory=list, description="uploads by s until the answer, see UPLOAD_SECONDS"
    )
    wait_seconds: Amount = Field(0.0, description="of all uploads together")
    bytes: Count = Field(0, description="of uploads")
    weights: Count = Field(0, description="times that weights were handed out")
    weights_bytes: Count = 0


class Status(StatusModel):
    """What a learner publishes about itself, about once a second."""

    run_id: str = ""
    run_name: str = ""
    program_version: str = ""
    verdict: str = Field("", description="one of VERDICTS, or words of a newer learner")
    state: str = Field("training", description="waiting, training, done, ...")
    phase: str = Field("", description="imitation, guided, reinforcement; empty: no teacher")
    phase_until: Count | None = Field(None, description="steps at which the phase ends")
    time: Amount = Field(description="unix s when this was written")
    uptime: Amount = 0.0
    steps: Count
    total_steps: Count
    updates: Count = 0
    weights_version: Count = 0
    host: str = ""
    machine: Machine = Machine()
    rate: Rate = Rate()
    eta: Amount | None = Field(None, description="s left")
    time_split: dict[str, Share] = Field(
        default_factory=dict, description="shares of the learner's last minute"
    )
    actor_split: dict[str, Share] = Field(
        default_factory=dict, description="shares of the actors' last minute, all together"
    )
    overhead_learner: Share | None = Field(None, description="see overhead()")
    overhead_actor: Share | None = None
    actors: list[ActorStatus] = Field(default_factory=list)
    episodes: Episodes = Episodes()
    ppo: Optimization = Optimization()
    lag: Lag = Lag()
    dropped: Dropped = Dropped()
    accounts: Accounts = Accounts()
    queue: Queue = Queue()
    events: list[Event] = Field(default_factory=list, description="newest last")
    checkpoint: Checkpoint | None = None
    session: Session = Session()
    traffic: Traffic = Traffic()
    validation: ValidationStatus | None = None


class HistoryRow(StatusModel):
    """One point of the learner's ring of past values."""

    time: Amount
    steps: Count = 0
    rate: Measured = None
    arrived: MeasuredShare = None
    collided: MeasuredShare = None
    lost: MeasuredShare = None
    timeout: MeasuredShare = None
    mean_return: Measured = None
    kl: Measured = None
    entropy: Measured = None
    lag: Measured = None


VERDICTS = (
    "compiling",
    "learning",
    "waiting for actors",
    "learner-bound",
    "actor-bound",
    "balanced",
    "stale",
    "done",
)
"""The words a learner uses for its own condition (``stale`` is the viewer's own finding)."""


def parse_status(data: Any, where: str = "status") -> Status:
    """Snapshot from plain JSON data; raises UserError naming ``where`` and the key."""
    return validate(Status, data, where)


def parse_history(data: Any, where: str = "status history") -> list[HistoryRow]:
    """History rows, oldest first, from plain JSON data; raises UserError."""
    if not isinstance(data, Sequence) or isinstance(data, str | bytes):
        raise UserError(f"{where}: must be a list of rows, not {type(data).__name__}")
    return [validate(HistoryRow, row, f"{where}, row {i}") for i, row in enumerate(data)]


def parse_reply(data: Any) -> tuple[Status, list[HistoryRow]]:
    """Both halves of a learner's answer ``{"snapshot": ..., "history": [...]}``.

    Raises UserError where the answer is not one of a learner.
    """
    if not isinstance(data, dict) or "snapshot" not in data:
        raise UserError("status: the answer holds no snapshot; is a learner of lndrl listening?")
    return parse_status(data["snapshot"]), parse_history(data.get("history") or [])
