"""Bytes on the wire: a msgpack header with a table of tensors, then the raw tensors.

Layout, little-endian: 8 bytes magic | u32 length of the head | head (msgpack
``[header, [[name, dtype, shape], ...]]``) | the arrays in table order, each starting at a multiple
of 64 bytes from the start of the message, zeros between. Offsets follow from the shapes, so there
is nothing in a message that could contradict itself.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from lndrl.errors import UserError

MAGIC = b"LNDRL\x00\x00\x01"
ALIGNMENT = 64
DTYPES = {
    name: np.dtype(name)
    for name in ("|u1", "<u2", "<u4", "<u8", "|i1", "<i2", "<i4", "<i8", "<f2", "<f4", "<f8")
}
MAX_DIMENSIONS = 8
MAX_LENGTH = 2**31
MAX_DEPTH = 24
ZEROS = bytes(ALIGNMENT)
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,63}\Z")


class MessageError(ValueError):
    """Bytes or values that are not a valid message; the text says what is wrong."""


class TooLargeError(MessageError, UserError):
    """A message that the other side would not take in."""


@dataclass(frozen=True)
class Limits:
    """What a receiver accepts: bytes of a message, bytes of its head, number of arrays."""

    max_bytes: int = 256 * 2**20
    max_head_bytes: int = 4 * 2**20
    max_arrays: int = 64


DEFAULT_LIMITS = Limits()


def pack(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]] | None = None) -> bytes:
    """One message from a header of plain values and named arrays of any shape.

    The arrays are copied exactly once. Allowed dtypes: (u)int8 to (u)int64, float32, float64.
    Raises MessageError for anything else.
    """
    table: list[list[Any]] = []
    sources: list[NDArray[Any]] = []
    for name, array in (arrays or {}).items():
        plain = _little_endian(name, array)
        table.append([name, plain.dtype.str, list(plain.shape)])
        sources.append(plain)
    try:
        head = msgpack.packb([dict(header), table], default=_plain_scalar)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise MessageError(f"header cannot be packed: {error}") from None
    parts: list[Any] = [MAGIC, len(head).to_bytes(4, "little"), head]
    position = len(MAGIC) + 4 + len(head)
    for source in sources:
        gap = -position % ALIGNMENT
        parts.append(ZEROS[:gap])
        position += gap + source.nbytes
        if source.nbytes:
            parts.append(np.ascontiguousarray(source).reshape(-1).view(np.uint8).data)
    return b"".join(parts)


def unpack(
    data: bytes | bytearray | memoryview, limits: Limits = DEFAULT_LIMITS
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of a message; the arrays are read-only views into ``data``, not copies.

    Checks everything before it allocates: size, magic, head, table, exact total length. Raises
    MessageError for any bytes that ``pack`` could not have written, and nothing else.
    """
    view = memoryview(data).cast("B").toreadonly()
    if len(view) > limits.max_bytes:
        raise MessageError(f"message of {len(view)} bytes exceeds {limits.max_bytes}")
    start = len(MAGIC) + 4
    if len(view) < start or bytes(view[: len(MAGIC)]) != MAGIC:
        raise MessageError("not an lndrl message (wrong magic)")
    length = int.from_bytes(view[len(MAGIC) : start], "little")
    if length > limits.max_head_bytes or start + length > len(view):
        raise MessageError(f"head of {length} bytes does not fit")
    header, table = _read_head(view[start : start + length], limits)
    arrays: dict[str, NDArray[Any]] = {}
    position = start + length
    for row in table:
        name, dtype, shape, size = _read_row(row)
        if name in arrays:
            raise MessageError(f"array {name} appears twice")
        position += -position % ALIGNMENT
        if position + size > len(view):
            raise MessageError(f"array {name} reaches beyond the message")
        try:
            # An empty buffer cannot be addressed at an offset, and needs no address. Neither this
            # nor the view can be written to, so the arrays cannot, either.
            if size:
                arrays[name] = np.ndarray(shape, dtype, view, position)
            else:
                arrays[name] = np.ndarray(shape, dtype, bytes(1))
        except (ValueError, TypeError, OverflowError) as error:
            raise MessageError(f"array {name}: {error}") from None
        position += size
    if position != len(view):
        raise MessageError(f"message has {len(view)} bytes, its table describes {position}")
    return header, arrays


def _little_endian(name: Any, array: Any) -> NDArray[Any]:
    if not isinstance(name, str) or not NAME.match(name):
        raise MessageError(f"array name {name!r} is not an identifier of at most 64 letters")
    if not isinstance(array, np.ndarray):
        raise MessageError(f"array {name} is a {type(array).__name__}, not a numpy array")
    little = array.dtype.newbyteorder("<")
    if little.str not in DTYPES:
        raise MessageError(f"array {name} has dtype {array.dtype}, which is not sent")
    if array.ndim > MAX_DIMENSIONS:
        raise MessageError(f"array {name} has {array.ndim} dimensions, more than {MAX_DIMENSIONS}")
    return array.astype(little, copy=False)


def _plain_scalar(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a value of type {type(value).__name__} is not plain")


def _read_head(view: memoryview, limits: Limits) -> tuple[dict[str, Any], list[Any]]:
    try:
        head = msgpack.unpackb(view, ext_hook=_refuse_extension, max_ext_len=0)
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException) as error:
        raise MessageError(f"head is not msgpack: {error}") from None
    if not isinstance(head, list) or len(head) != 2:
        raise MessageError("head must be [header, table]")
    header, table = head
    if not isinstance(header, dict) or not isinstance(table, list):
        raise MessageError("head must hold a map and a list")
    _check_nesting(header, 1)
    if len(table) > limits.max_arrays:
        raise MessageError(f"{len(table)} arrays exceed {limits.max_arrays}")
    return header, table


def _refuse_extension(code: int, _data: bytes) -> Any:
    raise ValueError(f"extension type {code} is not allowed")


def _check_nesting(value: dict[Any, Any] | list[Any], depth: int) -> None:
    """Text for keys, and not too deep; without extensions all else that msgpack has is plain."""
    if depth > MAX_DEPTH:
        raise MessageError("head is nested too deeply")
    if type(value) is dict:
        for key in value:
            if type(key) is not str:
                raise MessageError("keys of the head must be text")
    for inner in value.values() if type(value) is dict else value:
        if type(inner) is dict or type(inner) is list:
            _check_nesting(inner, depth + 1)


def _read_row(row: Any) -> tuple[str, np.dtype[Any], tuple[int, ...], int]:
    if type(row) is not list or len(row) != 3:
        raise MessageError("a table row must be [name, dtype, shape]")
    name, code, shape = row
    if type(name) is not str or not _is_name(name):
        raise MessageError("a table row has no valid name")
    dtype = DTYPES.get(code) if type(code) is str else None
    if dtype is None:
        raise MessageError(f"array {name} has a dtype that is not allowed")
    if type(shape) is not list or len(shape) > MAX_DIMENSIONS:
        raise MessageError(f"array {name} has no valid shape")
    for length in shape:
        if type(length) is not int or not 0 <= length < MAX_LENGTH:
            raise MessageError(f"array {name} has no valid shape")
    return name, dtype, tuple(shape), math.prod(shape) * dtype.itemsize


@lru_cache(256)  # the same few names in every message
def _is_name(name: str) -> bool:
    return NAME.match(name) is not None
