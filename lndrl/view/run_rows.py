"""The rows of a run's ``metrics.jsonl`` as models, and the scalars in them.

One row stands after each update and one for each validated version, in the order of their coming.
The learner writes them (``learner/rows.py``, ``learner/run/validation.py``); ``lndrl config schema
metrics`` prints the schema that is made of this.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import ConfigDict, Field, RootModel, create_model

from lndrl.models import MOST, Model
from lndrl.transport.status import ACTOR_ACTIVITIES, LEARNER_ACTIVITIES
from lndrl.wilson import wilson_interval

Whole = Annotated[int, Field(ge=0, le=MOST)]
Amount = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1.0 + 1e-6)]
OUTCOMES = ("arrived", "collided", "lost", "timeout")


class RecordedEpisodes(Model):
    """The newest episodes; null where there is none yet."""

    count: Whole = Field(description="episodes of the run")
    window: Whole = Field(description="the newest, behind all that follows")
    arrived: Share | None = Field(description="share that arrived")
    collided: Share | None = Field(description="share that touched something")
    lost: Share | None = Field(description="share whose belief went astray")
    timeout: Share | None = Field(description="share that ran out of time")
    mean_return: float | None = Field(description="undiscounted")
    mean_time: Amount | None = Field(description="s, of those that arrived")
    mean_distance: Amount | None = Field(description="m, of those that arrived")
    position_error: Amount | None = Field(description="m, of the belief, mean over steps")
    angle_error: Amount | None = Field(description="rad, likewise")
    variance_sum: Amount | None = Field(description="var_x + var_y + var_yaw, likewise")


class RecordedUpdate(Model):
    """What PPO did; a figure that was no number is null, one that this run has not is absent."""

    policy_loss: float | None = Field(None, description="mean over the gradient steps")
    value_loss: float | None = Field(None, description="likewise")
    entropy: float | None = Field(None, description="nats, of the policy over its states")
    kl: float | None = Field(None, description="nats, of the policy before from the one after")
    clip_fraction: float | None = Field(None, description="share of samples that were clipped")
    importance_max: float | None = Field(None, description="largest weight of a sample")
    teacher_kl: float | None = Field(None, description="nats, KL(teacher || policy)")
    teacher_agreement: float | None = Field(
        None, description="share of states where both like the same action best"
    )
    gradient_norm_policy: float | None = Field(None, description="before clipping, mean")
    gradient_norm_value: float | None = Field(None, description="likewise")
    explained_variance: float | None = Field(None, description="of the returns, by the values")
    learning_rate: float | None = Field(None, description="of the policy")
    entropy_weight: float | None = Field(None, description="where ppo.entropy_final anneals it")


class RecordedLag(Model):
    """Weights versions between acting and learning."""

    mean: Amount = Field(description="over the samples of the update")
    max: Whole = Field(description="the most of them")


class Spent(Model):
    """Seconds by activity since this learner started: what lies between two rows is exact."""

    learner: dict[str, Amount] = Field(description="of the learner's thread")
    actors: dict[str, Amount] = Field(description="of all actors together")
    actor_steps: Whole = Field(description="environment steps that they delivered")


class _Clock(Model):
    unix: Amount = Field(description="s since 1970 when the row was made")
    elapsed: Amount = Field(description="s of training over all sessions of the run")
    update: Amount = Field(description="s from the batch to the published weights")
    steps_per_second: Amount = Field(description="taken in, over the last minute")
    actors: Whole = Field(description="that are here")
    overhead_learner: Share | None = Field(description="busy time that is no update")
    overhead_actor: Share | None = Field(description="busy time that is no simulation")
    spent: Spent = Field(description="sums, for exact differences")


def _shares(prefix: str, whose: str, activities: tuple[str, ...]) -> dict[str, Any]:
    text = (
        "share of {}' last minute: {}" if whose.endswith("s") else "share of {}'s last minute: {}"
    )
    return {
        f"{prefix}{name}": (Share | None, Field(None, description=text.format(whose, name)))
        for name in activities
    }


RecordedTime: Any = create_model(
    "RecordedTime",
    __base__=_Clock,
    __doc__="When, how fast, and where the time went.",
    **_shares("share_", "the learner", LEARNER_ACTIVITIES),
    **_shares("actor_share_", "the actors", ACTOR_ACTIVITIES),
)


class UpdateRow(Model):
    """After an update of the networks."""

    update: Whole = Field(description="its number, from 1; a resume goes on with the next one")
    steps: Whole = Field(description="environment steps trained on, with this update")
    version: Whole = Field(description="of the weights that were published after it")
    samples: Whole = Field(description="of this update")
    episodes: RecordedEpisodes = Field(description="how the newest episodes ended")
    reward_parts: dict[str, float | None] = Field(
        description="mean sum per episode by part, those of the run's own terms as well"
    )
    phase: str = Field(description="imitation, guided or reinforcement, whatever the run has")
    ppo: RecordedUpdate = Field(description="figures of the update")
    lag: RecordedLag = Field(description="how old the samples were")
    time: RecordedTime = Field(description="when, how fast, where the time went")


class ValidatedEpisodes(Model):
    """How the episodes of a round ended."""

    episodes: Annotated[int, Field(ge=1, le=MOST)] = Field(description="of the round")
    arrived: Whole = Field(description="of them")
    collided: Whole = Field(description="of them")
    lost: Whole = Field(description="of them")
    timeout: Whole = Field(description="of them")
    steps: Whole = Field(description="control steps of all of them")


class ValidatedVersion(Model):
    """What an evaluator found of one version of the weights."""

    version: Whole = Field(description="of the weights")
    steps: Whole = Field(description="that they had been trained on")
    elapsed: Amount = Field(description="s of training before they were published")
    unix: Amount = Field(description="s since 1970 when the result was recorded")
    seconds: Amount = Field(description="that the round took")
    evaluator: str = Field(description="who found it")
    under: str = Field(description="hash of all that decides what the episodes are")
    sampled: ValidatedEpisodes = Field(description="actions drawn, as in training")
    greedy: ValidatedEpisodes = Field(description="the likeliest action always")


class ValidationRow(Model):
    """After the result of a validated version."""

    update: Whole = Field(description="the learner's when the result came")
    validation: ValidatedVersion = Field(description="what was found")


class MetricsRow(RootModel[UpdateRow | ValidationRow]):
    """A line of metrics.jsonl: after an update, or after the result of a validated version."""

    model_config = ConfigDict(frozen=True)


def scalars_of(row: Mapping[str, Any]) -> dict[str, float]:
    """The finite numbers of a row as ``group/name``; of a validated version, shares and intervals.

    TensorBoard and whatever else shows curves have them under these names.
    """
    validation = row.get("validation")
    if validation is not None:
        return _validated(validation)
    return {
        f"{group}/{name}": float(value)
        for group in ("episodes", "reward_parts", "ppo", "lag", "time")
        for name, value in row[group].items()
        if isinstance(value, int | float) and math.isfinite(value)
    }


def _validated(found: Mapping[str, Any]) -> dict[str, float]:
    scalars: dict[str, float] = {}
    for kind in ("sampled", "greedy"):
        counts = found[kind]
        shares = {name: counts[name] / counts["episodes"] for name in OUTCOMES}
        bounds = wilson_interval(counts["arrived"], counts["episodes"])
        shares |= zip(("arrived_low", "arrived_high"), bounds, strict=True)
        scalars |= {f"validation_{kind}/{name}": share for name, share in shares.items()}
    return scalars
