"""Weights as bytes and files: safetensors with the run's configuration in its metadata."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor, nn

from lndrl.config import RunConfig, parse_config
from lndrl.errors import UserError
from lndrl.numbering import checkpoints_in
from lndrl.policy.layout import CONFIG_KEY, explain_misfit
from lndrl.policy.networks import build_policy

POLICY_FILE = "policy.safetensors"
GUIDANCE_KEY = "lndrl.guidance"


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
        """What a safetensors blob says in its head (its length in 8 bytes, then JSON).

        Weights that say nothing ask for nothing. Raises UserError for what makes no sense.
        """
        try:
            head = json.loads(blob[8 : 8 + int.from_bytes(blob[:8], "little")])
            said = json.loads(head.get("__metadata__", {}).get(GUIDANCE_KEY, "{}"))
            found = cls(**said)
            if type(found.labels) is not bool or not 0.0 <= found.drives <= 1.0:
                raise ValueError(f"{said} is none")
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            raise UserError(f"weights: guidance that cannot be read ({error})") from None
        return found


def to_bytes(network: nn.Module, metadata: dict[str, str] | None = None) -> bytes:
    """All parameters of ``network`` as one safetensors blob (float32, on the CPU)."""
    tensors = {
        name: tensor.detach().to("cpu", torch.float32).contiguous()
        for name, tensor in network.state_dict().items()
    }
    return save_tensors(tensors, metadata)


def load_into(
    network: nn.Module, blob: bytes, where: str = "weights", config: RunConfig | None = None
) -> None:
    """Copy the tensors of ``blob`` into ``network``.

    Raises UserError when the blob is no safetensors file, holds other names or shapes, or a
    value that is not finite. Given the network's ``config``, it names the observation layout that
    the weights are for, where they say it.
    """
    try:
        tensors = load_tensors(blob)
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{where}: not a safetensors file ({error})") from None
    expected = network.state_dict()
    misfit = _misfit(tensors, expected)
    if misfit is not None:
        explained = explain_misfit(where, blob, config) if config is not None else None
        raise UserError(explained or f"{where}: {misfit}; these weights are of another network")
    _check_values(tensors, expected, where)
    with torch.no_grad():
        for name, target in expected.items():
            target.copy_(tensors[name])


def _misfit(tensors: dict[str, Tensor], expected: dict[str, Tensor]) -> str | None:
    """The first name or shape that is not ``expected``."""
    for name, target in expected.items():
        if name not in tensors:
            return f"{name} is missing"
        if tensors[name].shape != target.shape:
            return (
                f"{name} has shape {list(tensors[name].shape)} where this configuration "
                f"has {list(target.shape)}"
            )
    extra = sorted(set(tensors) - set(expected))
    return f"unknown tensor {extra[0]}" if extra else None


def _check_values(tensors: dict[str, Tensor], expected: dict[str, Tensor], where: str) -> None:
    for name, target in expected.items():
        if tensors[name].dtype != target.dtype:
            raise UserError(f"{where}: {name} is {tensors[name].dtype}, not {target.dtype}")
        # NaN and infinity both show in the extremes, ten times sooner than by looking one by one.
        if not all(math.isfinite(extreme) for extreme in torch.aminmax(tensors[name])):
            raise UserError(f"{where}: {name} holds values that are not finite")


def initial_weights(config: RunConfig) -> bytes:
    """Freshly initialized policy weights, seeded by ``config.seed``."""
    torch.manual_seed(config.seed)
    return to_bytes(build_policy(config))


def policy_metadata(config: RunConfig, version: int, steps: int) -> dict[str, str]:
    """What a policy file says of itself, so that the file alone can be evaluated."""
    return {
        CONFIG_KEY: json.dumps(config.model_dump(mode="json")),
        "lndrl.version": str(version),
        "lndrl.steps": str(steps),
    }


def load_policy(path: Path | str) -> tuple[RunConfig, bytes]:
    """Configuration and weights blob of a policy file, or of a run folder's newest checkpoint.

    Raises UserError naming the path when nothing usable is there.
    """
    file = _policy_file(Path(path))
    blob = _read(file)
    try:
        with safe_open(str(file), framework="pt") as opened:
            metadata = opened.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise UserError(f"{file}: not a safetensors file ({error})") from None
    if CONFIG_KEY not in metadata:
        raise UserError(f"{file}: has no configuration inside; give a policy file saved by lndrl")
    return parse_config(json.loads(metadata[CONFIG_KEY]), f"{file} (configuration)"), blob


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise UserError(f"{file}: cannot be read ({error.strerror})") from None


def _policy_file(path: Path) -> Path:
    if path.is_file():
        return path
    if not path.exists():
        raise UserError(f"{path}: no such run folder or weights file")
    for folder in (path, *reversed(checkpoints_in(path / "checkpoints"))):
        if (folder / POLICY_FILE).is_file():
            return folder / POLICY_FILE
    raise UserError(f"{path}: holds no checkpoint yet ({POLICY_FILE} expected)")
