"""The whole export: convert, compare, and only then write."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.navigation import Observation
from lndrl.policy.acting import PolicyRunner
from lndrl.policy.export.check import (
    RoundTrip,
    decisions_per_second,
    observations_met,
    open_session,
    round_trip,
)
from lndrl.policy.export.contract import METADATA_KEY, contract_for
from lndrl.policy.export.convert import check_installed, to_onnx, whose_parts
from lndrl.policy.networks import build_policy
from lndrl.policy.tensors import load_into
from lndrl.policy.weights import driven_at

_SEED = 20  # of the drive that is compared on; any would do
_TIMED = 0.5  # s per figure of speed


@dataclass(frozen=True)
class Exported:
    """A model that computes what its policy does.

    ``rates`` are decisions per second on one core, one at a time: of the model in ONNX Runtime,
    and of the policy in this program.
    """

    model: bytes
    contract: dict[str, Any]
    trip: RoundTrip
    rates: tuple[float, float]

    def write(self, out: Path) -> None:
        """Write ``out`` and its contract beside it, each whole or not at all; may raise OSError."""
        file = {
            "name": out.name,
            "bytes": len(self.model),
            "sha256": hashlib.sha256(self.model).hexdigest(),
        }
        text = json.dumps({**self.contract, "file": file}, indent=2) + "\n"
        _replace(out, self.model)
        _replace(contract_beside(out), text.encode())


def contract_beside(out: Path) -> Path:
    """Where the contract of the model ``out`` lies."""
    return out.with_suffix(".json")


def export_policy(
    config: RunConfig, weights: bytes, where: str, observations: int = 1000, timed: float = _TIMED
) -> Exported:
    """The policy of ``weights`` as an ONNX model, compared on ``observations`` really met.

    Its log-probabilities are those at the temperature that the weights are meant to be sampled at.
    ``where`` names the weights in errors; ``timed`` are the seconds per figure of speed. Raises
    UserError where a package is missing, the weights do not fit, the network cannot be exported,
    or the model computes something else.
    """
    check_installed()
    runner = PolicyRunner(config)
    runner.load(weights)
    temperature = driven_at(weights, where)
    network = build_policy(config, initialize=False)
    load_into(network, weights, where, config)
    model = to_onnx(config, network, where, temperature)
    contract = contract_for(config, weights, model.opset_import[0].version)
    entry = model.metadata_props.add()
    entry.key, entry.value = METADATA_KEY, json.dumps(contract)
    blob = model.SerializeToString()
    session = open_session(blob)
    met = observations_met(runner, observations, _SEED)
    trip = _compared(session, runner, met, where, temperature)
    return Exported(blob, contract, trip, decisions_per_second(session, runner, met, timed))


def _compared(
    session: Any, runner: PolicyRunner, met: Observation, where: str, temperature: float
) -> RoundTrip:
    try:
        trip = round_trip(session, runner, met, temperature)
    except Exception as error:  # ONNX Runtime's have no kind in common
        raise UserError(
            f"{where}: the exported network does not run: {str(error).splitlines()[0]}"
        ) from error
    if not trip.holds:
        parts = " and ".join(whose_parts(runner.config)) or "the network"
        differs = "NaN" if np.isnan(trip.difference) else f"{trip.difference:.2g}"
        raise UserError(
            f"{where}: the exported network's log-probabilities differ by {differs} from the "
            f"policy's over {trip.observations} observations, where {trip.tolerance:.1g} is "
            f"allowed, so nothing was written: {parts} must compute with tensors of its inputs "
            "alone"
        )
    return trip


def _replace(path: Path, content: bytes) -> None:
    half = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        half.write_bytes(content)
        half.replace(path)
    finally:
        half.unlink(missing_ok=True)
