"""Checkpoints: whole or absent, the newest few kept, never pickled.

A checkpoint is a folder ``checkpoints/step-000012345`` with both networks and the optimizers as
safetensors and everything else as JSON, including digests of the other files. It is written under
a temporary name, flushed to disk and renamed.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor

from learner.trainee import set_rate
from learner.update import PPO
from lndrl.errors import UserError
from lndrl.policy import POLICY_FILE, load_into, policy_metadata, to_bytes

VALUE_FILE = "value.safetensors"
OPTIMIZER_FILE = "optimizer.safetensors"
STATE_FILE = "state.json"
FORMAT = 1


@dataclass
class Counters:
    """How far the run has come; part of every checkpoint."""

    steps: int = 0
    updates: int = 0
    version: int = 0
    episodes: int = 0
    elapsed: float = 0.0  # s of training over all sessions


def save_checkpoint(
    folder: Path, ppo: PPO, counters: Counters, roster: dict[str, Any], keep: int
) -> Path:
    """Write a checkpoint into ``folder`` and delete all but the newest ``keep``.

    Raises OSError when the disk refuses; what was there before stays untouched.
    """
    name = f"step-{counters.steps:09d}"
    temporary = folder / f".{name}.partial"
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    metadata = policy_metadata(ppo.config, counters.version, counters.steps)
    files = {
        POLICY_FILE: to_bytes(ppo.policy, metadata),
        VALUE_FILE: to_bytes(ppo.value),
        OPTIMIZER_FILE: save_tensors(_optimizer_tensors(ppo)),
    }
    state = {
        "format": FORMAT,
        "counters": vars(counters),
        "roster": roster,
        "generator": ppo.rng.bit_generator.state,
        "learning_rates": [
            float(optimizer.param_groups[0]["lr"])
            for optimizer in (ppo.policy_optimizer, ppo.value_optimizer)
        ],
        "digests": {file: hashlib.sha256(data).hexdigest() for file, data in files.items()},
    }
    files[STATE_FILE] = json.dumps(state, indent=1).encode()
    for file, data in files.items():
        _write(temporary / file, data)
    target = folder / name
    shutil.rmtree(target, ignore_errors=True)
    temporary.rename(target)
    _flush_folder(folder)
    for old in list_checkpoints(folder)[:-keep]:
        shutil.rmtree(old, ignore_errors=True)
    return target


def list_checkpoints(folder: Path) -> list[Path]:
    """The checkpoints in ``folder``, oldest first."""
    return sorted(path for path in folder.glob("step-*") if path.is_dir())


def load_checkpoint(path: Path, ppo: PPO) -> tuple[Counters, dict[str, Any]]:
    """Restore ``ppo`` from ``path``; returns counters and the roster's state.

    Raises UserError for a damaged checkpoint (naming the one before it) or one of another
    network; ``ppo`` may then hold a part of it and must not be used.
    """
    try:
        state = json.loads((path / STATE_FILE).read_text())
        if state["format"] != FORMAT:
            raise UserError(f"{path}: has format {state['format']}, this program reads {FORMAT}")
        files = {name: _checked(path, name, digest) for name, digest in state["digests"].items()}
        optimizer = load_tensors(files[OPTIMIZER_FILE])
        counters = Counters(**state["counters"])
        generator, rates, roster = state["generator"], state["learning_rates"], state["roster"]
    except (OSError, ValueError, KeyError, TypeError, SafetensorError) as error:
        raise UserError(_damaged(path, error)) from None
    load_into(ppo.policy, files[POLICY_FILE], str(path / POLICY_FILE))
    load_into(ppo.value, files[VALUE_FILE], str(path / VALUE_FILE))
    _restore_optimizers(ppo, optimizer, rates, path)
    ppo.rng.bit_generator.state = generator
    return counters, roster


def start_from(run: Path, ppo: PPO) -> Path:
    """Give ``ppo`` networks and optimizers of the newest checkpoint of another run.

    Returns the checkpoint; raises UserError when there is none or it is of another network.
    """
    known = list_checkpoints(run / "checkpoints")
    if not known:
        raise UserError(f"learner.start: {run} holds no checkpoint; name the folder of a run")
    order = ppo.rng.bit_generator.state
    load_checkpoint(known[-1], ppo)
    ppo.rng.bit_generator.state = order  # the new run's seed decides, not where it came from
    return known[-1]


def find_checkpoint(folder: Path, name: str | None) -> Path:
    """The newest checkpoint in ``folder`` or the one called ``name``; raises UserError."""
    known = list_checkpoints(folder)
    if name is not None:
        if folder / name not in known:
            names = ", ".join(path.name for path in known) or "none"
            raise UserError(f"{folder}: has no checkpoint {name}; there are: {names}")
        return folder / name
    if not known:
        raise UserError(
            f"{folder}: holds no checkpoint to resume from; delete the run folder or choose "
            "another --run"
        )
    return known[-1]


def _optimizers(ppo: PPO) -> dict[str, tuple[torch.optim.Adam, torch.nn.Module]]:
    return {
        "policy": (ppo.policy_optimizer, ppo.policy),
        "value": (ppo.value_optimizer, ppo.value),
    }


def _optimizer_tensors(ppo: PPO) -> dict[str, Tensor]:
    """Adam's moments by network, parameter and name."""
    tensors = {}
    for owner, (optimizer, network) in _optimizers(ppo).items():
        for name, parameter in network.named_parameters():
            for key, tensor in optimizer.state.get(parameter, {}).items():
                tensors[f"{owner}/{name}/{key}"] = tensor.detach().cpu().contiguous()
    return tensors


def _restore_optimizers(
    ppo: PPO, tensors: dict[str, Tensor], rates: list[float], path: Path
) -> None:
    for (owner, (optimizer, network)), rate in zip(_optimizers(ppo).items(), rates, strict=True):
        set_rate(optimizer, rate)
        for name, parameter in network.named_parameters():
            moments = {}
            for key in ("step", "exp_avg", "exp_avg_sq"):
                tensor = tensors.get(f"{owner}/{name}/{key}")
                if tensor is None:
                    continue
                if key != "step" and tensor.shape != parameter.shape:
                    raise UserError(f"{path}: {owner}/{name} is of another network")
                # The step counter stays where torch keeps it for fused optimizers, and moments
                # lie in memory like their parameter: Adam goes through them side by side.
                like = tensor if key == "step" else parameter
                moments[key] = torch.empty_like(like, device=parameter.device).copy_(tensor)
            if moments:
                optimizer.state[parameter] = moments


def _checked(path: Path, name: str, digest: str) -> bytes:
    data = (path / name).read_bytes()
    if hashlib.sha256(data).hexdigest() != digest:
        raise ValueError(f"{name} is not what was written")
    return data


def _damaged(path: Path, error: Exception) -> str:
    before = [p.name for p in list_checkpoints(path.parent) if p.name < path.name]
    advice = f"use --checkpoint {before[-1]}, the one before" if before else "there is none before"
    return f"{path}: the checkpoint is damaged ({error}); {advice}"


def _write(path: Path, data: bytes) -> None:
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
