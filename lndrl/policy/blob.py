"""Safetensors as bytes: their head, and their tensors where they lie.

The library copies every tensor; weights are the largest thing that an actor ever receives, so here
they are views. Writing is the library's.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

Place = tuple[int, int]

_LENGTH = 8  # bytes that say how long the head is
_METADATA = "__metadata__"
_TYPES = {
    "F64": "<f8", "F32": "<f4", "F16": "<f2", "I64": "<i8", "I32": "<i4", "I16": "<i2", "I8": "i1",
    "U64": "<u8", "U32": "<u4", "U16": "<u2", "U8": "u1", "BOOL": "?",
}  # fmt: skip


def metadata_in(blob: bytes) -> dict[str, str]:
    """The metadata in the head of a safetensors blob; empty where it has none.

    Raises ValueError for what is no such blob.
    """
    said = head_in(blob)[0].get(_METADATA) or {}
    if not isinstance(said, dict) or not all(isinstance(each, str) for each in said.values()):
        raise ValueError("its metadata are no strings by name")
    return said


def tensors_in(blob: bytes) -> dict[str, NDArray[Any]]:
    """The tensors by name, read-only views of ``blob``, which stays as long as any of them.

    Raises ValueError for what is no safetensors blob, and for types that NumPy does not have.
    """
    head, start = head_in(blob)
    head.pop(_METADATA, None)
    data = memoryview(blob)[start:]
    tensors, places = {}, []
    for name, entry in head.items():
        tensors[name], place = _tensor(name, entry, data)
        places.append(place)
    if [0, *(end for _, end in sorted(places))] != [*(b for b, _ in sorted(places)), len(data)]:
        raise ValueError("its tensors do not lie one after the other")
    return tensors


def _tensor(name: str, entry: Any, data: memoryview) -> tuple[NDArray[Any], Place]:
    """The view that an entry of the head describes, and where it begins and ends."""
    try:
        kind, shape, (begin, end) = entry["dtype"], tuple(entry["shape"]), entry["data_offsets"]
    except (KeyError, TypeError, ValueError):
        raise ValueError(f"its head does not describe {name}") from None
    if type(kind) is not str or not all(type(n) is int for n in (*shape, begin, end)):
        raise ValueError(f"its head does not describe {name}")
    if kind not in _TYPES:
        raise ValueError(f"{name} has numbers of type {kind}")
    if not 0 <= begin <= end <= len(data) or any(n < 0 for n in shape):
        raise ValueError(f"{name} lies outside of it")
    found = np.frombuffer(data[begin:end], _TYPES[kind])
    if found.size != np.prod(shape, dtype=object):
        raise ValueError(f"{name} has {found.size:,} numbers for the shape {list(shape)}")
    return found.reshape(shape), (begin, end)


def head_in(blob: bytes) -> tuple[dict[str, Any], int]:
    """What stands in the head (its length in 8 bytes, then JSON), and where tensors begin.

    Raises ValueError for what is no safetensors blob.
    """
    start = _LENGTH + int.from_bytes(blob[:_LENGTH], "little")
    if len(blob) < _LENGTH or start > len(blob):
        raise ValueError("its head is cut off")
    try:
        head = json.loads(blob[_LENGTH:start])
    except RecursionError:
        raise ValueError("its head is nested too deeply") from None
    if not isinstance(head, dict):
        raise ValueError("its head is no table")
    return head, start
