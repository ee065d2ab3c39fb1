"""Safetensors read as views, against the library that wrote them."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from safetensors.numpy import load, save

from lndrl.policy.blob import metadata_in, tensors_in

TENSORS: dict[str, np.ndarray] = {
    "a.weight": np.arange(12, dtype=np.float32).reshape(3, 4),
    "b": np.array([1.5, -2.0], np.float16),
    "count": np.array(7, np.int64),
    "none": np.zeros((0, 3), np.float32),
}
BLOB = save(TENSORS, {"lndrl.steps": "5"})


def altered(**changes: Any) -> bytes:
    """The blob with entries of ``a.weight`` changed."""
    size = int.from_bytes(BLOB[:8], "little")
    head = json.loads(BLOB[8 : 8 + size])
    head["a.weight"].update(changes)
    text = json.dumps(head).encode()
    return len(text).to_bytes(8, "little") + text + BLOB[8 + size :]


def test_tensors_are_those_that_were_saved_and_lie_in_the_blob() -> None:
    found = tensors_in(BLOB)
    assert set(found) == set(TENSORS)
    for name, tensor in load(BLOB).items():
        np.testing.assert_array_equal(found[name], tensor)
        assert found[name].dtype == tensor.dtype
        assert not found[name].flags.writeable and not found[name].flags.owndata
    assert metadata_in(BLOB) == {"lndrl.steps": "5"}
    assert metadata_in(save(TENSORS)) == {}


@pytest.mark.parametrize(
    ("blob", "sentence"),
    [
        (b"", "cut off"),
        (b"nonsense", "cut off"),
        (BLOB[:40], "cut off"),
        ((4).to_bytes(8, "little") + b"[1] ", "no table"),
        (BLOB[:-1], "lies outside|one after the other"),
        (BLOB + b"more", "one after the other"),
        (altered(dtype="BF16"), "numbers of type BF16"),
        (altered(shape=[5, 4]), "12 numbers for the shape"),
        (altered(shape=[-3, -4]), "lies outside"),
        (altered(shape=["x"]), "does not describe a.weight"),
        (altered(data_offsets=[-48, 0]), "lies outside"),
        (altered(data_offsets=[0, 10**12]), "lies outside"),
        (altered(data_offsets=[0]), "does not describe a.weight"),
        (altered(data_offsets=[0, 47]), "."),
        (altered(shape=[], data_offsets=[0, 4]), "one after the other"),
        (altered(shape=[3.0, 4]), "does not describe a.weight"),
        (altered(shape=["3", 4]), "does not describe a.weight"),
        (altered(shape=[True, 12]), "does not describe a.weight"),
        (altered(shape=[float("inf")]), "does not describe a.weight"),
        (altered(data_offsets=[0, float("inf")]), "does not describe a.weight"),
        (altered(dtype=["F32"]), "does not describe a.weight"),
        (altered(dtype={}), "does not describe a.weight"),
        (altered(shape=[2**40, 2**40]), "numbers for the shape"),
    ],
)
def test_what_is_none_is_refused(blob: bytes, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        tensors_in(blob)


def test_metadata_that_are_no_strings_are_refused() -> None:
    text = json.dumps({"__metadata__": {"a": 1}}).encode()
    with pytest.raises(ValueError, match="no strings"):
        metadata_in(len(text).to_bytes(8, "little") + text)


@given(st.binary(max_size=80))
def test_any_bytes_are_tensors_or_refused(data: bytes) -> None:
    for blob in (data, len(data).to_bytes(8, "little") + data):
        with suppress(ValueError):
            assert all(isinstance(each, np.ndarray) for each in tensors_in(blob).values())


@given(st.integers(0, len(BLOB) - 1), st.integers(0, 255))
def test_a_byte_that_changed_on_the_way_is_no_surprise(place: int, value: int) -> None:
    blob = BLOB[:place] + bytes([value]) + BLOB[place + 1 :]
    with suppress(ValueError), np.errstate(all="ignore"):
        for tensor in tensors_in(blob).values():
            tensor.sum()
        metadata_in(blob)
