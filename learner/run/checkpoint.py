"""Checkpoints: whole or absent, the newest few kept, never pickled.

A checkpoint is a folder ``checkpoints/step-000012345`` with both networks and the optimizers as
safetensors and everything else as JSON, including digests of all that. It is written under a
temporary name, flushed to disk and renamed. The policy file is what is tested: where weights are
averaged (``learner.average``) it holds the average, and those in training have a file of their own.
``best`` beside them is no checkpoint: see ``best.py``.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor

from learner.ppo.adam import Adam
from learner.ppo.update import PPO
from learner.run.privilege import widened_moments, widened_value
from lndrl.config.shipped import SHIPPED_POLICIES, SHIPPED_POLICY
from lndrl.errors import UserError
from lndrl.numbering import checkpoint_name, checkpoints_in, step_of
from lndrl.policy import (
    POLICY_FILE,
    check_layout,
    load_into,
    policy_metadata,
    read_policy,
    to_bytes,
)

VALUE_FILE = "value.safetensors"
OPTIMIZER_FILE = "optimizer.safetensors"
TRAINED_FILE = "trained.safetensors"
"""The policy in training, where the policy file holds averaged weights."""
_TENSOR_FILES = (POLICY_FILE, VALUE_FILE, OPTIMIZER_FILE)
STATE_FILE = "state.json"
FORMAT = 1

_BOOKS = ("roster", "accounts")
_PARTIAL = ".partial"  # being written
_REPLACED = ".replaced"  # what a checkpoint of the same name takes the place of


@dataclass
class Counters:
    """How far the run has come; part of every checkpoint."""

    steps: int = 0
    updates: int = 0
    version: int = 0
    episodes: int = 0
    elapsed: float = 0.0  # s of training over all sessions


def save_checkpoint(
    folder: Path, ppo: PPO, counters: Counters, books: dict[str, Any], keep: int
) -> Path:
    """Write a checkpoint into ``folder`` and delete all but the newest ``keep``.

    ``books``: what else to remember, plain data under names of its own. Raises OSError when the
    disk refuses; what was there before stays untouched, and nothing half written remains.
    """
    target = write_folder(folder / checkpoint_name(counters.steps), _files(ppo, counters, books))
    for old in checkpoints_in(folder)[:-keep]:
        if old != target:
            shutil.rmtree(old, ignore_errors=True)
    return target


def write_folder(target: Path, files: dict[str, bytes]) -> Path:
    """Write ``target`` with ``files`` in it whole or not at all, in place of one of that name.

    Raises OSError; what was there before stays untouched then, and nothing half written remains.
    """
    temporary = target.with_name(f".{target.name}{_PARTIAL}")
    try:
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
        for file, data in files.items():
            _write(temporary / file, data)
        return _put_in_place(temporary, target)
    except OSError:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def clean_up(folder: Path) -> list[str]:
    """Remove what crashed writers left in ``folder``; returns the names.

    A checkpoint whose replacement never came gets its name back.
    """
    removed = []
    for path in sorted(folder.glob(f".*{_REPLACED}")):
        target = folder / path.name[1 : -len(_REPLACED)]
        if not target.exists():
            with suppress(OSError):
                path.rename(target)
    for pattern in (f".*{_PARTIAL}", f".*{_REPLACED}"):
        for path in sorted(folder.glob(pattern)):
            shutil.rmtree(path, ignore_errors=True)
            removed.append(path.name)
    return removed


def set_aside_later(path: Path) -> list[str]:
    """Rename the checkpoints after ``path``: the run goes on from there, they are another's story.

    Returns their names; those that the disk holds on to stay.
    """
    aside = []
    for later in checkpoints_in(path.parent):
        if step_of(later) > step_of(path):
            target = later.with_name(f"abandoned-{later.name}")
            shutil.rmtree(target, ignore_errors=True)
            with suppress(OSError):
                later.rename(target)
                aside.append(later.name)
    return aside


def load_checkpoint(path: Path, ppo: PPO) -> tuple[Counters, dict[str, Any]]:
    """Restore ``ppo`` from ``path``; returns counters and the books as they were saved.

    Raises UserError for a damaged checkpoint (naming the one before it) or one of another
    network or observation layout; ``ppo`` may then hold a part of it and must not be used.
    """
    try:
        state = _state(path)
        if state["format"] != FORMAT:
            raise UserError(f"{path}: has format {state['format']}, this program reads {FORMAT}")
        averaged = _averaged(state)
        names = (*_TENSOR_FILES, *((TRAINED_FILE,) if averaged else ()))
        files = {name: _checked(path, name, state["digests"][name]) for name in names}
        optimizer = load_tensors(files[OPTIMIZER_FILE])
        counters = _counters(state["counters"])
        generator, rates = state["generator"], [float(rate) for rate in state["learning_rates"]]
        books: dict[str, Any] = {name: state[name] for name in _BOOKS if name in state}
    except (OSError, ValueError, KeyError, TypeError, RecursionError, SafetensorError) as error:
        raise UserError(damaged(path, error)) from None
    trained = TRAINED_FILE if averaged else POLICY_FILE
    load_into(ppo.policy, files[trained], str(path / trained), ppo.config)
    if ppo.average is not None:
        load_into(ppo.average.network, files[POLICY_FILE], str(path / POLICY_FILE), ppo.config)
        ppo.average.updates = averaged
    where = str(path / VALUE_FILE)
    load_into(ppo.value, widened_value(files[VALUE_FILE], ppo.value, where), where)
    try:
        optimizer = widened_moments(optimizer, ppo.value)
        _restore_optimizers(ppo, optimizer, rates, path)
        ppo.rng.bit_generator.state = generator
    except (ValueError, KeyError, TypeError, OverflowError, RuntimeError) as error:
        raise UserError(damaged(path, error)) from None
    if not ppo.is_finite():
        raise UserError(damaged(path, "the optimizers' moments are not finite"))
    return counters, books


def start_from(named: str | Path, ppo: PPO) -> Path:
    """Give ``ppo`` networks and optimizers of another run's newest checkpoint, or of ``named``
    itself where it is a checkpoint. Of a policy file, or ``shipped``, it gets the policy alone.

    Returns what it was; raises UserError when there is none or it is of another network.
    """
    run = Path(named)
    if named in SHIPPED_POLICIES or run.is_file():
        try:
            policy = read_policy(named)
            check_layout(str(run), policy.config, ppo.config)
        except UserError as error:
            raise UserError(f"learner.start: {error}") from None
        load_into(ppo.policy, policy.weights, str(run), ppo.config)
        if ppo.average is not None:
            load_into(ppo.average.network, policy.weights, str(run), ppo.config)
        return run
    known = [run] if (run / STATE_FILE).is_file() else checkpoints_in(run / "checkpoints")
    if not known:
        raise UserError(
            f"learner.start: {run} holds no checkpoint; name the folder of a run, one of its "
            f"checkpoints/step-..., a policy file or {SHIPPED_POLICY}"
        )
    order = ppo.rng.bit_generator.state
    load_checkpoint(known[-1], ppo)
    ppo.rng.bit_generator.state = order  # the new run's seed decides, not where it came from
    return known[-1]


def find_checkpoint(folder: Path, name: str | None) -> Path:
    """The newest checkpoint in ``folder`` or the one called ``name``; raises UserError."""
    known = checkpoints_in(folder)
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


def damaged(path: Path, why: Exception | str) -> str:
    """A sentence about a checkpoint that cannot be used, naming the one before it."""
    before = [p.name for p in checkpoints_in(path.parent) if step_of(p) < step_of(path)]
    advice = f"use --checkpoint {before[-1]}, the one before" if before else "there is none before"
    if isinstance(why, KeyError):
        why = f"{why} is missing"
    return f"{path}: the checkpoint is damaged ({why}); {advice}"


def _files(ppo: PPO, counters: Counters, books: dict[str, Any]) -> dict[str, bytes]:
    """The files of a checkpoint, by name."""
    metadata = policy_metadata(ppo.config, counters.version, counters.steps)
    files = {
        POLICY_FILE: to_bytes(ppo.tested, metadata),
        VALUE_FILE: to_bytes(ppo.value),
        OPTIMIZER_FILE: save_tensors(_optimizer_tensors(ppo)),
    }
    if ppo.average is not None:
        files[TRAINED_FILE] = to_bytes(ppo.policy, metadata)  # what a misfit is explained by
        books = {**books, "averaged": ppo.average.updates}
    state = {
        "format": FORMAT,
        "counters": vars(counters),
        **books,
        "generator": ppo.rng.bit_generator.state,
        "learning_rates": [
            optimizer.rate for optimizer in (ppo.policy_optimizer, ppo.value_optimizer)
        ],
        "digests": {file: hashlib.sha256(data).hexdigest() for file, data in files.items()},
    }
    state["digest"] = _digest_of(state)
    return {**files, STATE_FILE: json.dumps(state, indent=1).encode()}


def _digest_of(state: dict[str, Any]) -> str:
    """Digest of all entries but the digest itself."""
    rest = {name: value for name, value in state.items() if name != "digest"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def _state(path: Path) -> dict[str, Any]:
    state = json.loads((path / STATE_FILE).read_text("utf-8"))
    if not isinstance(state, dict):
        raise ValueError(f"{STATE_FILE} holds no map")
    # Checkpoints of before there was a digest have none.
    if "digest" in state and state["digest"] != _digest_of(state):
        raise ValueError(f"{STATE_FILE} is not what was written")
    return state


def _averaged(state: dict[str, Any]) -> int:
    """Updates that the policy file averages; 0: none, it holds the policy in training."""
    if TRAINED_FILE not in state["digests"]:
        return 0
    averaged = state["averaged"]
    if type(averaged) is not int or not 0 <= averaged < 2**53:
        raise ValueError(f"averaged cannot be {averaged!r}")
    return averaged


def _counters(data: Any) -> Counters:
    counters = Counters(**data)
    for name, value in vars(counters).items():
        kind = float if name == "elapsed" else int
        if type(value) not in (int, kind) or not 0 <= value < float("inf"):
            raise ValueError(f"{name} cannot be {value!r}")
    return counters


def _put_in_place(temporary: Path, target: Path) -> Path:
    """Rename; one of the same name steps aside until the new one has taken its place."""
    replaced = target.with_name(f".{target.name}{_REPLACED}")
    if target.exists():
        shutil.rmtree(replaced, ignore_errors=True)
        target.rename(replaced)
    try:
        temporary.rename(target)
    except OSError:
        if replaced.exists():
            replaced.rename(target)
        raise
    shutil.rmtree(replaced, ignore_errors=True)
    _flush_folder(target.parent)
    return target


def _optimizers(ppo: PPO) -> dict[str, tuple[Adam, torch.nn.Module]]:
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
        optimizer.rate = rate
        for name, parameter in network.named_parameters():
            moments = {}
            for key in ("step", "exp_avg", "exp_avg_sq"):
                tensor = tensors.get(f"{owner}/{name}/{key}")
                if tensor is None:
                    continue
                if key != "step" and tensor.shape != parameter.shape:
                    raise UserError(f"{path}: {owner}/{name} is of another network")
                # Moments lie in memory like their parameter: Adam goes through them side by side.
                like = tensor if key == "step" else parameter
                moments[key] = torch.empty_like(like, device=parameter.device).copy_(tensor)
            if moments:
                optimizer.state[parameter] = moments


def _checked(path: Path, name: str, digest: str) -> bytes:
    data = (path / name).read_bytes()
    if hashlib.sha256(data).hexdigest() != digest:
        raise ValueError(f"{name} is not what was written")
    return data


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
