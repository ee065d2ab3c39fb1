"""How many actors one machine runs: a first choice, and what the load then says.

Actors and learner share the machine's cores. Too few actors let the learner wait; too many take
cores from its update and then wait for it. Costs below are of ``configs/lndrl.yaml``; they need
to be right within a factor of two or so, as ``Balance`` mends the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

from lndrl.config import RunConfig
from lndrl.transport.status import balance_word

STEP_COST = 0.45 + 0.6
"""ms of one core per environment step: simulation and inference."""
SAMPLE_COST = 2 * 0.3
"""ms of one core per sample before the epochs: ingest, values, log-probabilities."""
EPOCH_COST = 2 * 1.1
"""ms of one core per sample and epoch, both networks."""


@dataclass(frozen=True)
class Choice:
    """Actor processes, worlds in each, and the cores that the learner computes on."""

    actors: int
    worlds: int
    learner_threads: int


def first_choice(config: RunConfig, cores: int, learner_device: str = "cpu") -> Choice:
    """What ``lndrl train`` starts with on ``cores`` cores; a number that is configured stays.

    A learner on the CPU gets cores in proportion to its work, though two at least: its networks
    train side by side. One on a GPU leaves all cores but two to the actors, for feeding the GPU
    and for what arrives.
    """
    on_cpu = learner_device == "cpu"
    if on_cpu:
        learning = SAMPLE_COST + EPOCH_COST * config.ppo.epochs
        actors = round(cores * STEP_COST / (STEP_COST + learning))
    else:
        actors = cores - 2
    actors = max(1, actors)
    if config.actor.count != "auto" or config.learner.mode == "lockstep":
        actors = config.fixed_actors
    threads = config.learner.threads or (cores - actors if on_cpu else 2)
    if not config.learner.threads:
        threads = max(min(2, cores), threads)
    return Choice(actors, config.worlds_per_actor(actors), threads)


class Balance:
    """Says when a running fleet should grow or shrink by one.

    Slow on purpose: what it is told must hold for HOLD s, after every change it rests for REST s,
    and every change of mind doubles that rest, as the right number then lies between two.

    Args:
        most: the fleet never grows beyond this; the cores that it may use.
    """

    WINDOW = 30.0  # s behind each share it is told
    HOLD = 20.0
    REST, LONGEST_REST = 60.0, 1800.0

    def __init__(self, most: int) -> None:
        self.most = most
        self._rest = self.REST
        self._rest_until = 0.0
        self._wish, self._wished_at = 0, 0.0
        self._last = 0

    def advise(
        self, now: float, actors: int, learner_waits: float, actors_idle: float, settled: bool
    ) -> int:
        """1: one actor more, -1: one less, 0: as it is. Advice given counts as taken.

        ``now`` monotonic s; ``learner_waits`` and ``actors_idle`` shares of the last WINDOW s;
        ``settled`` False while shares mean little: before the first update, and while an actor
        starts or leaves.
        """
        if not settled:
            self._wish = 0
            self._rest_until = max(self._rest_until, now + self.WINDOW)
            return 0
        wish = self._wanted(actors, learner_waits, actors_idle)
        if wish != self._wish:
            self._wish, self._wished_at = wish, now
        if not wish or now < self._rest_until or now - self._wished_at < self.HOLD:
            return 0
        if wish == -self._last:
            self._rest = min(2.0 * self._rest, self.LONGEST_REST)
        self._last, self._wish, self._rest_until = wish, 0, now + self._rest
        return wish

    def _wanted(self, actors: int, learner_waits: float, actors_idle: float) -> int:
        word = balance_word(learner_waits, actors_idle)
        # Actors that idle while the learner waits lack something that one more would lack too.
        if word == "actor-bound" and actors < self.most and actors_idle < 0.5:
            return 1
        return -1 if word == "learner-bound" and actors > 1 else 0
