"""The names of a learner's metrics: the one place that has them, whoever serves them.

``lndrl_…_total`` count what this learner has done since it started; ``lndrl_run_…`` are of the run,
from before a resume as well, and may go back to a checkpoint. Labels have few values, known before:
no actor, host or text of a message is one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import accumulate

from prometheus_client.metrics_core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)

from lndrl.transport import COUNTS
from lndrl.transport.status import (
    GUIDED,
    IMITATION,
    MOST_LAG,
    REINFORCEMENT,
    UPLOAD_SECONDS,
    VERDICTS,
    Counts,
    Status,
    ValidationStatus,
)

OUTCOMES = COUNTS[1:-1]
"""How an episode ends."""
MOST_WANTED, LEAST_WANTED = 4.0, 0.25
"""Bounds of ``lndrl_actors_wanted_ratio``: shares of a minute say little beyond."""


def families(status: Status) -> Iterator[Metric]:
    """All metrics that ``status`` has figures for."""
    for group in (_run, _counters, _histograms, _episodes, _learning, _flow, _actors, _machines):
        yield from group(status)
    if status.validation is not None:
        yield from _validation(status.validation)


def wanted_ratio(status: Status) -> float:
    """How many times as many actors the learner could use as it has.

    From the shares of the last minute: of a learner that waits half of its time for two actors,
    2; of actors that wait half of theirs for the learner, 0.5; 1 before there is anything to tell.
    """
    learner = status.time_split.get("wait", 0.0)
    actors = status.actor_split.get("wait", 0.0)
    if not (status.updates and status.actor_split):
        return 1.0
    ratio = (1.0 - actors) / max(1.0 - learner, 1e-3)
    return min(MOST_WANTED, max(LEAST_WANTED, ratio))


def _run(status: Status) -> Iterator[Metric]:
    names = {"run": status.run_name, "run_id": status.run_id, "version": status.program_version}
    yield InfoMetricFamily("lndrl_run", "Which run this is, and of which program.", names)
    yield from _gauges(
        ("run_steps", "Environment steps the run has trained on.", status.steps),
        ("run_steps_target", "Steps at which the run is finished.", status.total_steps),
        ("run_updates", "Updates of the networks in the run.", status.updates),
        ("run_episodes", "Episodes that ended in the run.", status.episodes.count),
        ("run_remaining_seconds", "Left until the run has its steps, at its pace.", status.eta),
        ("status_timestamp_seconds", "When the learner last said how it is.", status.time),
        ("weights_version", "Newest published version of the weights.", status.weights_version),
    )
    if status.checkpoint is not None and status.checkpoint.age is not None:
        written = status.time - status.checkpoint.age
        text = "When the newest checkpoint of this learner was written."
        yield GaugeMetricFamily("lndrl_checkpoint_timestamp_seconds", text, written)
    verdict, phases = status.verdict.partition(":")[0], (IMITATION, GUIDED, REINFORCEMENT)
    for name, text, words, present in (
        ("verdict", "1 at the learner's judgement of itself.", VERDICTS, verdict),
        ("phase", "1 at what the policy learns by, where it has a teacher.", phases, status.phase),
    ):
        if present in words:
            values = {word: float(word == present) for word in words}
            yield _labelled(f"lndrl_{name}", text, name, values)
    samples = {"waiting": status.accounts.waiting, "trained": status.accounts.trained}
    text = "Acknowledged samples of the run by what became of them."
    fates = {**samples, **dict(sorted(status.accounts.dropped.items()))}
    counts = {fate: float(tally.samples) for fate, tally in fates.items()}
    yield _labelled("lndrl_run_samples", text, "fate", counts)


def _counters(status: Status) -> Iterator[Metric]:
    session, traffic = status.session, status.traffic
    began = session.started or None
    for name, text, value in (
        ("steps", "Environment steps trained on.", session.steps),
        ("updates", "Updates of the networks.", session.updates),
        ("upload_bytes", "Bytes of uploads.", traffic.bytes),
        ("weights_sent", "Times that weights were handed out.", traffic.weights),
        ("weights_sent_bytes", "Bytes of weights that were handed out.", traffic.weights_bytes),
    ):
        yield CounterMetricFamily(f"lndrl_{name}", text, value, created=began)
    ended = CounterMetricFamily("lndrl_episodes", "Episodes that ended.", labels=["outcome"])
    for outcome in OUTCOMES:
        ended.add_metric([outcome], session.episodes.get(outcome, 0), created=began)
    yield ended
    uploads = CounterMetricFamily("lndrl_uploads", "Uploads by answer.", labels=["answer"])
    for answer, count in traffic.answers.items():
        uploads.add_metric([answer], count, created=began)
    yield uploads


def _histograms(status: Status) -> Iterator[Metric]:
    session, traffic = status.session, status.traffic
    if session.lags:
        yield HistogramMetricFamily(
            "lndrl_sample_lag_versions",
            "Samples by weights versions between acting and learning.",
            _buckets(range(MOST_LAG), session.lags),
            session.lag_sum,
        )
    if traffic.waits:
        yield HistogramMetricFamily(
            "lndrl_upload_seconds",
            "Uploads by time from their coming to their answer, in the learner.",
            _buckets(UPLOAD_SECONDS, traffic.waits),
            traffic.wait_seconds,
        )


def _episodes(status: Status) -> Iterator[Metric]:
    episodes = status.episodes
    shares = {name: getattr(episodes, name) for name in OUTCOMES}
    text = "Share of the newest episodes that ended so."
    yield _labelled("lndrl_outcome_ratio", text, "outcome", shares)
    yield from _gauges(
        ("outcome_window_episodes", "Episodes behind those shares.", episodes.window),
        ("return_mean", "Mean return of the newest episodes.", episodes.mean_return),
        ("reach_seconds_mean", "Mean time of those that arrived.", episodes.mean_time),
        ("reach_meters_mean", "Mean way of those that arrived.", episodes.mean_distance),
        ("position_error_meters", "Mean error of the belief.", episodes.position_error),
    )


def _learning(status: Status) -> Iterator[Metric]:
    ppo = status.ppo
    yield from _gauges(
        ("policy_loss", "Policy loss of the newest update.", ppo.policy_loss),
        ("value_loss", "Value loss of the newest update.", ppo.value_loss),
        ("entropy_nats", "Entropy of the policy, mean over its states.", ppo.entropy),
        ("kl_nats", "KL of the policy before the update from the one after it.", ppo.kl),
        ("clip_ratio", "Share of samples whose ratio was clipped.", ppo.clip_fraction),
        ("explained_variance", "Of the returns, by the values.", ppo.explained_variance),
        ("learning_rate", "Learning rate of the policy.", ppo.learning_rate),
        ("importance_max", "Largest weight of a sample.", ppo.importance_max),
        ("teacher_kl_nats", "KL of the policy from its teacher.", ppo.teacher_kl),
        (
            "teacher_agreement_ratio",
            "Share of states in which policy and teacher like the same action best.",
            ppo.teacher_agreement,
        ),
        ("lag_versions", "Mean lag of the newest update's samples.", status.lag.mean),
        ("lag_max_versions", "Largest lag among them.", status.lag.max),
    )
    norms = {"policy": ppo.gradient_norm_policy, "value": ppo.gradient_norm_value}
    text = "Norm of the gradient before clipping, mean over the newest update."
    yield _labelled("lndrl_gradient_norm", text, "network", norms)


def _flow(status: Status) -> Iterator[Metric]:
    queue = status.queue
    yield from _gauges(
        ("steps_per_second", "Steps taken in, over the last minute.", status.rate.seconds_60),
        ("queue_chunks", "Uploads that wait to be learned from.", queue.chunks),
        ("queue_bytes", "Memory that they take.", queue.megabytes * 1e6),
        ("learner_overhead_ratio", "Busy time that is no update.", status.overhead_learner),
        ("actor_overhead_ratio", "Busy time that is no simulation.", status.overhead_actor),
    )
    for name, whose, split in (
        ("learner", "learner's", status.time_split),
        ("actor", "actors'", status.actor_split),
    ):
        text = f"Shares of the {whose} last minute by activity."
        yield _labelled(f"lndrl_{name}_time_ratio", text, "activity", dict(sorted(split.items())))


def _actors(status: Status) -> Iterator[Metric]:
    states = [actor.state for actor in status.actors]
    counts = {state: float(states.count(state)) for state in ("active", "slow", "gone")}
    yield _labelled("lndrl_actors", "Actors by state.", "state", counts)
    here = [actor for actor in status.actors if actor.state != "gone"]
    ages = [actor.last_ack_age for actor in here if actor.last_ack_age is not None]
    text = "How many times as many actors the learner could use as it has."
    yield from _gauges(
        ("actors_wanted_ratio", text, wanted_ratio(status)),
        ("actor_worlds", "Worlds of the actors that are here.", sum(a.worlds for a in here)),
        (
            "actor_restarts",
            "Further lives of the actors in the table.",
            sum(a.restarts for a in status.actors),
        ),
        (
            "actor_silent_seconds",
            "Longest time since an acknowledged upload of one that is here.",
            max(ages, default=None),
        ),
    )


def _machines(status: Status) -> Iterator[Metric]:
    """The learner's machine, and the actors' together: hosts come and go, and are no labels."""
    hosts = {a.host: a.machine for a in status.actors if a.state != "gone" and a.machine.cores}
    machines = list(hosts.values())
    yield from _gauges(("actor_machines", "Machines that actors run on.", len(machines)))
    for name, text, learner, of in (
        ("cpu", "CPU in use", status.machine.cpu, lambda machine: machine.cpu),
        ("memory", "Memory in use", status.machine.memory, lambda machine: machine.memory),
    ):
        if status.machine.cores:
            text_of_one = f"{text} on the learner's machine, as a share."
            yield GaugeMetricFamily(f"lndrl_learner_machine_{name}_ratio", text_of_one, learner)
        if machines:
            values: list[float] = [of(machine) for machine in machines]
            yield _labelled(
                f"lndrl_actor_machines_{name}_ratio",
                f"{text} on the machines of actors, as a share.",
                "statistic",
                {"least": min(values), "mean": sum(values) / len(values), "most": max(values)},
            )


def _validation(validation: ValidationStatus) -> Iterator[Metric]:
    """The newest point of the validated curve, and its best one."""
    newest = validation.points[-1] if validation.points else None
    for name, text, point in (
        ("validation", "the newest validated version", newest),
        ("validation_best", "the best validated version", validation.best),
    ):
        if point is None:
            continue
        steps = f"Steps that {text} had been trained on."
        yield GaugeMetricFamily(f"lndrl_{name}_run_steps", steps, point.steps)
        arrived = {"sampled": _share(point.sampled), "greedy": _share(point.greedy)}
        arrivals = f"Share of validation episodes in which {text} arrived."
        yield _labelled(f"lndrl_{name}_arrived_ratio", arrivals, "policy", arrived)


def _share(counts: Counts) -> float | None:
    return counts.arrived / counts.episodes if counts.episodes else None


def _gauges(*rows: tuple[str, str, float | None]) -> Iterator[Metric]:
    """(name without ``lndrl_``, help, value); what has no value is left out."""
    for name, text, value in rows:
        if value is not None:
            yield GaugeMetricFamily(f"lndrl_{name}", text, value)


def _labelled(name: str, text: str, label: str, values: Mapping[str, float | None]) -> Metric:
    family = GaugeMetricFamily(name, text, labels=[label])
    for word, value in values.items():
        if value is not None:
            family.add_metric([word], value)
    return family


def _buckets(bounds: Sequence[float], counts: Sequence[int]) -> list[tuple[str, float]]:
    """Cumulative counts by upper bound; ``counts`` has one class more, for what is beyond."""
    names = [*(str(float(bound)) for bound in bounds), "+Inf"]
    padded = [*counts, *([0] * (len(names) - len(counts)))]
    return list(zip(names, map(float, accumulate(padded)), strict=True))
