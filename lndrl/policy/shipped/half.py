"""Weights in half precision: a policy file of half the size, which acts in single precision.

A float16 keeps 11 of the 24 binary digits. Files stay safetensors with the same names and the same
metadata; whoever reads one gets the numbers back as float32.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save as save_tensors

from lndrl.errors import UserError
from lndrl.policy.blob import head_in, tensors_in

SHIPPED_FILE = Path(__file__).resolve().with_name("policy.safetensors")
"""Where an installed program has its policy."""
ROBOT_FILE = SHIPPED_FILE.with_name("robot.safetensors")
"""The same for bases whose velocities take time, where a build has one."""
WALK_FILE = SHIPPED_FILE.with_name("walk.npz")
"""A walk of it that was recorded, for whoever waits for the first one."""
LARGEST_FILE = 16_000_000
"""bytes that it may have."""


def narrowed(blob: bytes, metadata: Mapping[str, str], where: str = "weights") -> bytes:
    """``blob`` (safetensors, float32) with every tensor as float16, and ``metadata``.

    Raises UserError for a number that float16 does not have.
    """
    tensors = tensors_in(blob)
    for name, tensor in tensors.items():
        with np.errstate(over="ignore"):
            half = tensor.astype(np.float16)
        if not np.isfinite(half).all():
            raise UserError(
                f"{where}: {name} holds a number beyond {np.finfo(np.float16).max:g}, the "
                "largest in half precision; these weights cannot be shipped"
            )
        tensors[name] = half
    return _saved(tensors, metadata)


def widened(blob: bytes, metadata: Mapping[str, str]) -> bytes:
    """``blob`` with its float16 tensors as float32; itself where it has none."""
    tensors = tensors_in(blob)
    if all(tensor.dtype != np.float16 for tensor in tensors.values()):
        return blob
    wide = {
        name: tensor.astype(np.float32) if tensor.dtype == np.float16 else tensor
        for name, tensor in tensors.items()
    }
    return _saved(wide, metadata)


def _saved(tensors: dict[str, NDArray[Any]], metadata: Mapping[str, str]) -> bytes:
    """A safetensors blob that is the same, byte for byte, every time.

    The library writes metadata in any order, and results are known by the digest of the weights.
    """
    blob = save_tensors(tensors)
    head, start = head_in(blob)
    text = json.dumps({"__metadata__": dict(sorted(metadata.items())), **head}).encode()
    text += b" " * (-len(text) % 8)  # tensors begin at a multiple of 8 bytes
    return len(text).to_bytes(8, "little") + text + blob[start:]


def parameters_in(blob: bytes) -> int:
    """How many numbers the tensors of a safetensors blob have."""
    return sum(tensor.size for tensor in tensors_in(blob).values())
