"""The round trip: an exported policy beside the one it was made of, on observations really met."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.machine.threads import kept_threads, set_threads
from lndrl.navigation import Observation, VectorNavigation
from lndrl.navigation.observation import dequantise
from lndrl.navigation.terms import as_tested
from lndrl.policy.acting import PolicyRunner
from lndrl.policy.export.graph import OUTPUT, goal_values

if TYPE_CHECKING:
    import onnxruntime

TOLERANCE = 1e-4
"""Most that a log-probability may differ: rounding in another order of sums stays far below."""
_NOISE = 1e-6  # of rounding, in policies that say nearly the same to everything
_WORLDS = 16
_BATCHES = (1, 7, 64)  # one after the other: a graph must not remember the size it was made with

Feeds = dict[str, NDArray[np.generic]]


@dataclass(frozen=True)
class RoundTrip:
    """Observations compared, and the largest difference of a log-probability.

    ``spread`` is how far the policy's own answers lie apart: the largest deviation of an action's
    log-probability over the observations.
    """

    observations: int
    difference: float
    spread: float

    @property
    def tolerance(self) -> float:
        """What ``difference`` may be; less for a policy that hardly looks yet.

        The first weights of a run give nearly the same probabilities to everything: a graph that
        has lost an input would differ by less than TOLERANCE.
        """
        return min(TOLERANCE, max(_NOISE, 0.05 * self.spread))

    @property
    def holds(self) -> bool:
        """Whether the exported policy computes the same."""
        return self.difference <= self.tolerance


def open_session(model: bytes) -> onnxruntime.InferenceSession:
    """A session of one thread on the CPU."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def observations_met(runner: PolicyRunner, count: int, seed: int) -> Observation:
    """``count`` observations that the policy meets where it was trained, acting as in training."""
    # What it is paid does not matter here, and terms of one's own would have to be trusted.
    config = as_tested(runner.config).model_copy(update={"seed": seed})
    worlds = VectorNavigation(config, worlds=min(_WORLDS, count))
    generator = np.random.default_rng(seed)
    parts, number = [worlds.observation.copy()], len(worlds)
    while number < count:
        action, _ = runner.act(worlds.observation, generator)
        worlds.step(action)
        parts.append(worlds.observation.copy())
        number += len(worlds)
    return Observation.concatenate(parts).take(slice(0, count))


def feeds_for(observation: Observation, config: RunConfig) -> Feeds:
    """What the exported graph reads where the policy reads ``observation`` (N,)."""
    feeds: Feeds = {
        "scan": dequantise(observation.scan, config.world.laser.range_max),
        "goal": np.ascontiguousarray(observation.goal[:, : goal_values(config)]),
    }
    if config.network.pedestrian_map:
        feeds["people"] = observation.pedestrians
        feeds["count"] = observation.pedestrian_count.astype(np.int64)
    return feeds


def round_trip(
    session: onnxruntime.InferenceSession,
    runner: PolicyRunner,
    met: Observation,
    temperature: float = 1.0,
) -> RoundTrip:
    """Compare the answers of ``session`` and ``runner`` to ``met`` (N,), batch by batch.

    Those of ``runner`` are taken at ``temperature``, as those of ``session`` are.
    """
    difference, answers = 0.0, []
    for part in _pieces(met):
        (exported,) = session.run([OUTPUT], feeds_for(part, runner.config))
        answer = at_temperature(runner.log_probabilities(part), temperature)
        # max() of Python would let NaN pass.
        difference = float(np.maximum(difference, np.abs(exported - answer).max()))
        answers.append(answer)
    spread = float(np.concatenate(answers).std(axis=0).max())
    return RoundTrip(len(met), difference, spread)


def at_temperature(
    log_probabilities: NDArray[np.floating], temperature: float
) -> NDArray[np.floating]:
    """What ``log_probabilities`` (N, A) at temperature 1 are at ``temperature``."""
    if temperature == 1.0:
        return log_probabilities
    scores = log_probabilities.astype(np.float64) / temperature
    total: NDArray[np.floating] = np.logaddexp.reduce(scores, axis=1, keepdims=True)
    return scores - total


def decisions_per_second(
    session: onnxruntime.InferenceSession, runner: PolicyRunner, met: Observation, seconds: float
) -> tuple[float, float]:
    """How often per second, on one core, ``session`` and ``runner`` answer one observation."""
    singles = [met.take(slice(i, i + 1)) for i in range(min(len(met), 64))]
    feeds = [feeds_for(single, runner.config) for single in singles]
    with kept_threads():
        set_threads(1)
        return (
            _rate(lambda i: session.run([OUTPUT], feeds[i]), len(singles), seconds),
            _rate(lambda i: runner.log_probabilities(singles[i]), len(singles), seconds),
        )


def _rate(decide: Callable[[int], object], count: int, seconds: float) -> float:
    """Decisions per second, by the median of single ones."""
    taken: list[float] = []
    begin = time.perf_counter()
    while not taken or time.perf_counter() - begin < seconds:
        before = time.perf_counter()
        decide(len(taken) % count)
        taken.append(time.perf_counter() - before)
    return 1.0 / float(np.median(taken))


def _pieces(met: Observation) -> Iterator[Observation]:
    begin, turn = 0, 0
    while begin < len(met):
        end = begin + _BATCHES[turn % len(_BATCHES)]
        yield met.take(slice(begin, end))
        begin, turn = end, turn + 1
