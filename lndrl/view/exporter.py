"""A learner's status as Prometheus reads it: ``lndrl metrics``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector

from lndrl.errors import UserError
from lndrl.transport.status import Status

MOST_WANTED, LEAST_WANTED = 4.0, 0.25
"""Bounds of ``lndrl_actors_wanted_ratio``: shares of a minute say little beyond."""


class StatusCollector(Collector):
    """Asks ``look`` for the status whenever somebody scrapes; an error of it is ``lndrl_up`` 0."""

    def __init__(self, look: Callable[[], Status]) -> None:
        self._look = look

    def describe(self) -> list[Any]:
        """Nothing is known before the first scrape."""
        return []

    def collect(self) -> Iterator[Any]:
        """All metrics of this moment."""
        try:
            status = self._look()
        except UserError:
            yield GaugeMetricFamily("lndrl_up", "Whether the learner answers.", 0)
            return
        yield GaugeMetricFamily("lndrl_up", "Whether the learner answers.", 1)
        yield from _counts(status)
        yield from _gauges(status)
        yield from _labelled(status)


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


def _counts(status: Status) -> Iterator[Any]:
    for name, text, value in (
        ("steps", "Environment steps trained on.", status.steps),
        ("updates", "Updates of the networks.", status.updates),
        ("episodes", "Episodes that ended.", status.episodes.count),
    ):
        yield CounterMetricFamily(f"lndrl_{name}", text, value)


def _gauges(status: Status) -> Iterator[Any]:
    for name, text, value in (
        ("weights_version", "Newest published version.", status.weights_version),
        ("steps_per_second", "Over the last minute.", status.rate.seconds_60),
        ("lag_versions", "Mean lag of the last update.", status.lag.mean),
        ("queue_chunks", "Uploads that wait.", status.queue.chunks),
        ("queue_megabytes", "Uploads that wait.", status.queue.megabytes),
        ("arrived_ratio", "Share of the last episodes that arrived.", status.episodes.arrived),
        (
            "actors_wanted_ratio",
            "How many times as many actors the learner could use as it has.",
            wanted_ratio(status),
        ),
    ):
        if value is not None:
            yield GaugeMetricFamily(f"lndrl_{name}", text, value)


def _labelled(status: Status) -> Iterator[Any]:
    actors = GaugeMetricFamily("lndrl_actors", "Actors by state.", labels=["state"])
    states = [actor.state for actor in status.actors]
    for state in ("active", "slow", "gone"):
        actors.add_metric([state], states.count(state))
    yield actors
    samples = CounterMetricFamily(
        "lndrl_samples", "Acknowledged samples by what became of them.", labels=["fate"]
    )
    samples.add_metric(["trained"], status.accounts.trained.samples)
    for rule, tally in sorted(status.accounts.dropped.items()):
        samples.add_metric([rule], tally.samples)
    yield samples
    for name, split in (("learner", status.time_split), ("actor", status.actor_split)):
        shares = GaugeMetricFamily(
            f"lndrl_{name}_time_ratio", "Shares of the last minute.", labels=["activity"]
        )
        for activity, share in sorted(split.items()):
            shares.add_metric([activity], share)
        yield shares
