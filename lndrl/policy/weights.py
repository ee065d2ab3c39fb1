"""Weights as bytes and files: safetensors with the run's configuration in its metadata.

Arrays alone; what makes tensors of them is in ``tensors``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig, parse_config
from lndrl.config.shipped import ROBOT_POLICY, SHIPPED_POLICIES
from lndrl.errors import UserError
from lndrl.models import TEMPERATURES
from lndrl.numbering import BEST, checkpoints_in
from lndrl.policy.blob import metadata_in, tensors_in
from lndrl.policy.layout import CONFIG_KEY, explain_misfit
from lndrl.policy.shapes import Shapes
from lndrl.policy.shipped import ROBOT_FILE, SHIPPED_FILE, widened
from lndrl.version import VERSION

POLICY_FILE = "policy.safetensors"
NEWEST = "newest"
VALIDATED_KEY = "lndrl.validated"
"""Entry of a policy file's metadata: counts of validation episodes that it was chosen by, JSON."""
GUIDANCE_KEY = "lndrl.guidance"
TEMPERATURE_KEY = "lndrl.temperature"
"""Entry of a policy file's metadata: what its actions are meant to be sampled at."""


@dataclass(frozen=True)
class Guidance:
    """What actors are to do with the run's teacher while they act on some weights.

    labels: let it label the states that they meet. drives: share of worlds that it drives.
    """

    labels: bool = False
    drives: float = 0.0

    def to_metadata(self) -> dict[str, str]:
        """Entries beside the weights that ``of`` reads back."""
        return {GUIDANCE_KEY: json.dumps({"labels": self.labels, "drives": self.drives})}

    @classmethod
    def of(cls, blob: bytes) -> Guidance:
        """What a safetensors blob says in its head.

        Weights that say nothing ask for nothing. Raises UserError for what makes no sense.
        """
        try:
            said = json.loads(metadata_in(blob).get(GUIDANCE_KEY, "{}"))
            found = cls(**said)
            if type(found.labels) is not bool or not 0.0 <= found.drives <= 1.0:
                raise ValueError(f"{said} is none")
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            raise UserError(f"weights: guidance that cannot be read ({error})") from None
        return found


def read_tensors(
    blob: bytes, shapes: Shapes, where: str = "weights", config: RunConfig | None = None
) -> dict[str, NDArray[np.float32]]:
    """The tensors of ``blob``, which are those that ``shapes`` names: read-only views.

    What travels in half precision comes as float32, in memory of its own.
    Raises UserError when the blob is no safetensors file, holds other names or shapes, or a
    value that is not finite. Given the network's ``config``, it names the observation layout that
    the weights are for, where they say it.
    """
    try:
        tensors = tensors_in(blob)
    except ValueError as error:
        raise UserError(f"{where}: not a safetensors file ({error})") from None
    misfit = _misfit(tensors, shapes)
    if misfit is not None:
        explained = explain_misfit(where, blob, config) if config is not None else None
        raise UserError(explained or f"{where}: {misfit}; these weights are of another network")
    for name, tensor in tensors.items():
        if tensor.dtype == np.float16:
            tensor = tensors[name] = tensor.astype(np.float32)
        if tensor.dtype != np.float32:
            raise UserError(f"{where}: {name} is {tensor.dtype}, not float32")
        # NaN and infinity both show in the extremes, sooner than by looking one by one.
        if tensor.size and not (math.isfinite(tensor.min()) and math.isfinite(tensor.max())):
            raise UserError(f"{where}: {name} holds values that are not finite")
    return tensors


def _misfit(tensors: Mapping[str, NDArray[np.generic]], shapes: Shapes) -> str | None:
    """The first name or shape that is not among ``shapes``."""
    for name, shape in shapes.items():
        if name not in tensors:
            return f"{name} is missing"
        if tensors[name].shape != shape:
            return (
                f"{name} has shape {list(tensors[name].shape)} where this configuration "
                f"has {list(shape)}"
            )
    extra = sorted(set(tensors) - set(shapes))
    return f"unknown tensor {extra[0]}" if extra else None


def policy_metadata(config: RunConfig, version: int, steps: int) -> dict[str, str]:
    """What a policy file says of itself, so that the file alone can be evaluated."""
    return {
        CONFIG_KEY: json.dumps(config.model_dump(mode="json")),
        "lndrl.version": str(version),
        "lndrl.steps": str(steps),
    }


@dataclass(frozen=True)
class PolicyFile:
    """Weights, the configuration that they were trained under, and where they come from.

    ``origin`` says which it is: of a run's policy e.g. "newest checkpoint, step 81,920", of the
    shipped one that it is; empty for a file that the user has named. ``temperature``: what its
    actions are meant to be sampled at, see ``driven_at``.
    """

    config: RunConfig
    weights: bytes
    origin: str = ""
    temperature: float = 1.0


def load_policy(path: Path | str) -> tuple[RunConfig, bytes]:
    """Configuration and weights blob of a policy file, or of a run folder; see ``read_policy``."""
    found = read_policy(path)
    return found.config, found.weights


def read_policy(path: Path | str, checkpoint: str | None = None) -> PolicyFile:
    """A policy file, or the policy of a run folder: the best validated one, else the newest.

    ``checkpoint`` names another of the run: newest, best or step-000081920. ``shipped`` is the
    policy that comes with the program; a folder of that name is ``./shipped`` as text, or its whole
    path. What a file has in half precision comes as float32. Raises UserError naming the path when
    nothing usable is there, and for a checkpoint of what is no run.
    """
    name = str(path)
    named = name in SHIPPED_POLICIES and path in (name, Path(name))
    if named and checkpoint is not None:
        raise UserError(
            f"{name}: is one policy, which has no checkpoint {checkpoint}; a folder of "
            f"that name is ./{name}"
        )
    file = _shipped_file(name) if named else _policy_file(Path(path), checkpoint)
    blob = _read(file)
    metadata = _metadata(file, blob)
    if CONFIG_KEY not in metadata:
        raise UserError(f"{file}: has no configuration inside; give a policy file saved by lndrl")
    try:
        data = json.loads(metadata[CONFIG_KEY])
    except (ValueError, RecursionError):
        raise UserError(f"{file}: the configuration inside is damaged") from None
    config = parse_config(data, f"{file} (configuration)")
    origin = ""
    if named:
        origin = f"the policy that comes with lndrl {VERSION}{_trained(metadata)}"
    elif file.parent.parent.name == "checkpoints":
        origin = _origin(file, metadata)
    return PolicyFile(config, widened(blob, metadata), origin, _temperature(metadata, str(file)))


def _shipped_file(name: str) -> Path:
    """Where this build has the policy ``name``; raises UserError where it has none."""
    if name != ROBOT_POLICY:
        return SHIPPED_FILE
    if not ROBOT_FILE.is_file():
        raise UserError(
            f"{name}: this build comes without it; train it by lndrl train {name} --run robot, and "
            "name runs/robot"
        )
    return ROBOT_FILE


def driven_at(weights: bytes, where: str = "weights") -> float:
    """The temperature that a policy is meant to be sampled at: what its metadata say, else 1.

    Raises UserError for one that is none.
    """
    try:
        metadata = metadata_in(weights)
    except ValueError:
        return 1.0
    return _temperature(metadata, where)


def _temperature(metadata: Mapping[str, str], where: str) -> float:
    least, most = TEMPERATURES
    said = metadata.get(TEMPERATURE_KEY, "1")
    try:
        temperature = float(said)
        if not least <= temperature <= most:
            raise ValueError
    except ValueError:
        raise UserError(
            f"{where}: {TEMPERATURE_KEY} is {said!r} inside, and must be from {least:g} to {most:g}"
        ) from None
    return temperature


def _metadata(file: Path, blob: bytes) -> dict[str, str]:
    """What a blob says of itself.

    From the blob, not from the file: a run that goes on may have put another in its place.
    """
    try:
        tensors_in(blob)
        return metadata_in(blob)
    except ValueError as error:
        raise UserError(f"{file}: not a safetensors file ({error})") from None


def _trained(metadata: Mapping[str, str]) -> str:
    steps = metadata.get("lndrl.steps", "")
    return f", trained for {int(steps):,} steps" if steps.isdecimal() else ""


def _origin(file: Path, metadata: dict[str, str]) -> str:
    """Which policy of its run a file is."""
    known = checkpoints_in(file.parent.parent)
    name = "best" if file.parent.name == BEST else "an older"
    if known and file.parent.name == known[-1].name:
        name = NEWEST
    steps = metadata.get("lndrl.steps", "")
    step = f", step {int(steps):,}" if steps.isdecimal() else ""
    try:
        counts = json.loads(metadata[VALIDATED_KEY])
        share = counts["arrived"] / counts["episodes"]
        validated = f", {share:.2f} of {counts['episodes']:,} validated"
    except (KeyError, ValueError, TypeError, ZeroDivisionError):
        validated = ""
    return f"{name} checkpoint{step}{validated}"


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise UserError(f"{file}: cannot be read ({error.strerror})") from None


def _policy_file(path: Path, checkpoint: str | None) -> Path:
    if path.is_file() and checkpoint is None:
        return path
    if not path.exists():
        raise UserError(f"{path}: no such run folder or weights file")
    if checkpoint is None and (path / POLICY_FILE).is_file():
        return path / POLICY_FILE
    folder = path / "checkpoints"
    steps = [step for step in checkpoints_in(folder) if (step / POLICY_FILE).is_file()]
    best = [folder / BEST] if (folder / BEST / POLICY_FILE).is_file() else []
    if checkpoint is None:
        found = best or steps[-1:]
    elif checkpoint == NEWEST:
        found = steps[-1:]
    else:
        found = [each for each in (*best, *steps) if each.name == checkpoint]
    if found:
        return found[0] / POLICY_FILE
    if checkpoint is None:
        raise UserError(f"{path}: holds no checkpoint yet ({POLICY_FILE} expected)")
    names = ", ".join(each.name for each in (*best, *steps)) or "none"
    raise UserError(f"{path}: has no checkpoint {checkpoint}; there are: {names}")
