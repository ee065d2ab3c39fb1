"""``lndrl bench policy``: acting on one core, on observations of the hybrid scenario."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from lndrl.bench.report import device_name, median_seconds
from lndrl.bench.scene import hybrid_config, observations
from lndrl.config import RunConfig
from lndrl.machine.threads import kept_threads, set_threads
from lndrl.navigation import Observation, draw_pedestrian_map
from lndrl.policy import (
    Inputs,
    Network,
    PolicyRunner,
    build_policy,
    initial_weights,
    load_into,
    prepare,
    resolve_device,
)

BATCH = 64
"""Worlds of an actor where few actors share a machine."""
OTHER_BATCHES = (8, 32)
BATCH_GPU, OTHER_BATCHES_GPU = 4096, (64, 512)
IN_VIEW = (2, 4)  # people
_VARIETY = 8
_MET = 4096


def measure(seconds: float, device: str = "cpu") -> dict[str, Any]:
    """``samples_per_second`` of ``PolicyRunner.act`` with 2 to 4 people in view, by one thread.

    A sample is one observation, drawing of the pedestrian map and sampling of the action
    included. ``by_batch`` has other batch sizes, ``samples_per_second_as_met`` the people that
    randomly driven worlds show. ``samples_per_second_dense`` evaluates the same networks densely
    on the CPU, from which log-probabilities differ by ``max_difference`` at most;
    ``samples_per_second_bf16`` does its products in bfloat16. Raises UserError when ``device`` is
    not there.
    """
    config = hybrid_config()
    with kept_threads():
        set_threads(1)
        place = resolve_device(device)
        runner = _runner(config, device)
        on_cpu = place.type == "cpu"
        batch, others = (BATCH, OTHER_BATCHES) if on_cpu else (BATCH_GPU, OTHER_BATCHES_GPU)
        met = observations(config, _MET, 1)[0]
        count = met.pedestrian_count
        crowded = met.take((count >= IN_VIEW[0]) & (count <= IN_VIEW[1]))
        coarse = _runner(config, device, bfloat16=True)
        return {
            "samples_per_second": acting_rate(runner, crowded, batch, seconds),
            "device": device_name(place),
            "batch": batch,
            "people_in_view": float(crowded.pedestrian_count.mean()),
            "by_batch": {str(b): acting_rate(runner, crowded, b, seconds) for b in others},
            "samples_per_second_as_met": acting_rate(runner, met, batch, seconds),
            "samples_per_second_dense": _dense_rate(crowded, seconds),
            "samples_per_second_bf16": acting_rate(coarse, crowded, batch, seconds),
            "bf16_instructions": not on_cpu or bool(torch.cpu._is_avx512_bf16_supported()),
            "max_difference": _difference(runner, crowded),
        }


def _runner(config: RunConfig, device: str, bfloat16: bool = False) -> PolicyRunner:
    runner = PolicyRunner(config, device, bfloat16)
    runner.load(initial_weights(config))
    return runner


def acting_rate(runner: PolicyRunner, met: Observation, batch: int, seconds: float) -> float:
    """Samples per second that ``runner`` acts on in batches, rows of ``met`` in turn."""
    generator = np.random.default_rng(0)
    pieces = _pieces(met, batch)

    def act_on_all() -> None:
        # Different observations one after the other: how many people are in view matters.
        for observation in pieces:
            runner.act(observation, generator)

    return _VARIETY * batch / median_seconds(act_on_all, seconds)


def _dense_rate(met: Observation, seconds: float) -> float:
    pieces = _pieces(met, BATCH)[:2]
    config = hybrid_config()
    network = build_policy(config).requires_grad_(False)

    def act_on_all() -> None:
        for observation in pieces:
            _dense(network, observation, config)

    return len(pieces) * BATCH / median_seconds(act_on_all, seconds)


def _difference(runner: PolicyRunner, met: Observation) -> float:
    """Largest difference of log-probabilities to the dense evaluation, in float32."""
    config = runner.config
    reference = build_policy(config, initialize=False).requires_grad_(False)
    load_into(reference, initial_weights(config))
    return max(
        float(np.abs(runner.log_probabilities(piece) - _dense(reference, piece, config)).max())
        for piece in _pieces(met, BATCH)
    )


def _dense(network: Network, observation: Observation, config: RunConfig) -> Any:
    with torch.inference_mode():
        logits = network(_drawn(observation, config))
        return torch.log_softmax(logits, dim=1).numpy()


def _drawn(observation: Observation, config: RunConfig) -> Inputs:
    maps = draw_pedestrian_map(observation.pedestrians, observation.pedestrian_count, config.task)
    people = torch.from_numpy(maps).contiguous(memory_format=torch.channels_last)
    nobody = observation.copy()
    nobody.pedestrian_count[:] = 0
    inputs = prepare(nobody, config)
    return Inputs(inputs.scan, inputs.goal, people)


def _pieces(met: Observation, batch: int) -> list[Observation]:
    rows = np.arange(_VARIETY * batch) % len(met)
    return [met.take(part) for part in np.split(rows, _VARIETY)]
