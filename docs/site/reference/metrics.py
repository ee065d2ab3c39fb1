"""A page about what is measured, from the classes that hold it."""

from __future__ import annotations

import dataclasses
import time

from docs.site.reference.text import code, plain, said, table
from lndrl.evaluation.metrics import Metrics, Rate, Spread
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.transport.status import ACTOR_ACTIVITIES, LEARNER_ACTIVITIES, VERDICTS, Status
from lndrl.view.monitoring import StatusCollector


def metrics_page() -> str:
    """Of evaluations, of episodes, of a run's time, and for Prometheus."""
    return f"""# Metrics

## The nine of `lndrl evaluate`

{said(Metrics.__doc__)}

{_fields(Metrics)}

`Rate`: {said(Rate.__doc__)}

`Spread`: {said(Spread.__doc__)}

## Of an episode

{said(EpisodeRecord.__doc__)}

{_fields(EpisodeRecord)}

Parts of the reward: {", ".join(map(code, REWARD_PARTS))}, and the terms of one's own.

## Where time goes

Activities of a learner: {", ".join(map(code, LEARNER_ACTIVITIES))}.

Activities of an actor: {", ".join(map(code, ACTOR_ACTIVITIES))}.

Seconds of them sum to the wall time; [training](../training.md#where-the-time-goes) reads them.

What a learner says of itself: {", ".join(map(code, VERDICTS))}.

## For Prometheus

What `--metrics-port` of a learner and `lndrl metrics` serve, before the first episode:

{_prometheus()}
"""


def _fields(model: type) -> str:
    rows = [(code(each.name), code(each.type)) for each in dataclasses.fields(model)]
    return table(("field", "type"), rows)


def _prometheus() -> str:
    status = Status(time=time.time(), steps=1, total_steps=2, updates=1)
    rows = []
    for family in StatusCollector(lambda: status).collect():
        name = f"{family.name}_total" if family.type == "counter" else family.name
        rows.append((code(name), family.type, plain(family.documentation)))
    return table(("metric", "type", "what it is"), rows)
