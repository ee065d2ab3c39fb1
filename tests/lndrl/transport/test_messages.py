"""Messages: what goes in comes out, and no bytes whatever raise anything but MessageError."""

from __future__ import annotations

import contextlib
import tracemalloc

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from lndrl.transport import messages
from lndrl.transport.messages import (
    COUNTS,
    Ack,
    ChunkHeader,
    EvaluatorHello,
    Hello,
    Limits,
    MessageError,
    Refusal,
    ValidationResult,
    ValidationTask,
    WeightsAnnouncement,
    Welcome,
    decode,
    encode,
    pack,
    unpack,
)
from lndrl.transport.wire import ALIGNMENT, MAGIC

DTYPES = ["u1", "<u2", "<u4", "<u8", "i1", "<i2", "<i4", "<i8", "<f2", "<f4", "<f8", ">f4", ">u2"]
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)
arrays_of_any_kind = st.dictionaries(
    st.from_regex(r"[a-z_][a-z0-9_]{0,8}", fullmatch=True),
    st.sampled_from(DTYPES).flatmap(
        lambda dtype: hnp.arrays(dtype, hnp.array_shapes(min_dims=0, min_side=0, max_side=5))
    ),
    max_size=4,
)


def same(first: object, second: object) -> bool:
    return repr(first) == repr(second)


@settings(max_examples=60)
@given(st.dictionaries(st.text(max_size=5), plain, max_size=4), arrays_of_any_kind)
def test_round_trip(header, arrays):
    got, views = unpack(pack(header, arrays))
    assert same(got, header)
    assert list(views) == list(arrays)
    for name, array in arrays.items():
        assert views[name].shape == array.shape
        assert views[name].dtype == array.dtype.newbyteorder("<")
        assert views[name].tobytes() == array.astype(views[name].dtype).tobytes()
        assert not views[name].flags.writeable


def test_views_are_aligned_and_share_the_message():
    data = pack({"a": 1}, {"x": np.arange(3, dtype=np.uint8), "y": np.ones((2, 3))})
    start = np.frombuffer(data, np.uint8).ctypes.data
    _, views = unpack(data)
    for view in views.values():
        offset = view.ctypes.data - start
        assert offset % ALIGNMENT == 0
        assert 0 < offset < len(data)


def test_arrays_that_are_not_contiguous_arrive_in_order():
    array = np.arange(24, dtype=np.float32).reshape(4, 6)
    _, views = unpack(pack({}, {"x": array[::2, ::-1], "y": array.T}))
    assert np.array_equal(views["x"], array[::2, ::-1])
    assert np.array_equal(views["y"], array.T)


EXAMPLE = pack(
    {"kind": "chunk", "body": {"a": [1, 2.5, None, "text"]}},
    {"x": np.arange(10, dtype=np.uint16), "y": np.ones((2, 3), np.float32), "z": np.ones((0, 4))},
)


@settings(max_examples=200)
@given(st.data())
def test_any_mutation_is_refused_or_valid(data):
    mutated = bytearray(EXAMPLE)
    for _ in range(data.draw(st.integers(1, 4))):
        # Most of the meaning is in the head, so most mutations go there.
        where = data.draw(st.integers(0, 90) | st.integers(0, len(mutated) - 1))
        mutated[min(where, len(mutated) - 1)] = data.draw(st.integers(0, 255))
    cut = data.draw(st.none() | st.integers(0, len(mutated)))
    mutated = mutated[:cut]
    try:
        header, arrays = unpack(bytes(mutated))
    except MessageError:
        return
    assert unpack(pack(header, arrays))[0].keys() == header.keys()
    assert sum(array.nbytes for array in arrays.values()) <= len(mutated)


@given(st.binary(max_size=300))
def test_any_bytes_after_the_magic_are_refused_or_valid(tail):
    for head in (b"", MAGIC, MAGIC + len(tail).to_bytes(4, "little")):
        try:
            header, _ = unpack(head + tail)
        except MessageError:
            continue
        assert isinstance(header, dict)


def forged(head: bytes, tail: bytes = b"") -> bytes:
    return MAGIC + len(head).to_bytes(4, "little") + head + tail


@pytest.mark.parametrize(
    "head",
    [
        b"\xdd\xff\xff\xff\xff",  # a list of 2**32 - 1 entries
        b"\xdf\xff\xff\xff\xff",  # a map of as many
        b"\xdb\xff\xff\xff\xff",  # a text of as many bytes
        b"\x91" * 100_000,  # lists in lists in lists
        msgpack.packb([{}, [["x", "<f8", [2**31 - 1, 2**31 - 1, 2**31 - 1]]]]),
        msgpack.packb([{}, [["x", "<f8", [0, 2**31 - 1, 2**31 - 1, 2**31 - 1]]]]),
        msgpack.packb([{}, [["x", "<f8", [2**62, 0]]]]),
        msgpack.packb([{}, [["x", "<f8", [-1]]]]),
        msgpack.packb([{}, [["x", "<f8", [True]]]]),
        msgpack.packb([{}, [["x", "|O", [1]]]]),
        msgpack.packb([{}, [["x", "<f8", [1]]]]),
        msgpack.packb([{}, [["a/b", "<f8", [0]]]]),
        msgpack.packb([{}, [["x", "<f8", [0]], ["x", "<f8", [0]]]]),
        msgpack.packb([{}, [[f"x{i}", "|u1", [0]] for i in range(65)]]),
        msgpack.packb([{1: 2}, []]),
        msgpack.packb([{b"a": 2}, []]),
        b"\x92\x81\xa1a" + b"\x91" * 40 + b"\xc0\x90",  # forty lists deep
        msgpack.packb([{"t": msgpack.Timestamp(1)}, []]),
        msgpack.packb([{"t": msgpack.ExtType(5, b"x")}, []]),
        msgpack.packb([[], []]),
        msgpack.packb({}),
    ],
)
def test_forged_heads_are_refused_without_taking_memory(head):
    tracemalloc.start()
    with pytest.raises(MessageError):
        unpack(forged(head))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20_000_000


def test_size_and_trailing_bytes_are_checked():
    with pytest.raises(MessageError, match="exceeds"):
        unpack(EXAMPLE, Limits(max_bytes=len(EXAMPLE) - 1))
    with pytest.raises(MessageError, match="does not fit"):
        unpack(EXAMPLE, Limits(max_head_bytes=10))
    with pytest.raises(MessageError, match="describes"):
        unpack(EXAMPLE + b"\0")


@pytest.mark.parametrize(
    "array", [np.ones(2, bool), np.array(["a"]), np.array([None]), np.ones(2, complex), [1, 2]]
)
def test_other_types_are_not_sent(array):
    with pytest.raises(MessageError):
        pack({}, {"x": array})


@pytest.mark.parametrize("header", [{"a": object()}, {"a": 2**70}, {"a": "\ud800"}, {"a": {1}}])
def test_headers_that_are_not_plain_are_not_sent(header):
    with pytest.raises(MessageError):
        pack(header)


def test_numpy_scalars_in_headers_become_plain():
    assert unpack(pack({"a": np.float32(0.5), "b": np.int64(3)}))[0] == {"a": 0.5, "b": 3}


COUNTED = dict(zip(COUNTS, (6, 3, 2, 1, 0, 300), strict=True))
ALL = [
    Hello("a-1", "i1", "host", 3, 8, "0.1"),
    Welcome("run", {"seed": 1}, 0, 4, "abc"),
    Refusal("no"),
    ChunkHeader("run", "a-1", "i1", 1, 64, 8, [{"outcome": "arrived"}], {"infer": 0.5}, "h", 1),
    Ack("accepted", 3, "abc", "", True),
    WeightsAnnouncement(3, 100, "00", "abc"),
    EvaluatorHello("e-1", "i1", "host", 3, "0.1"),
    ValidationTask("run", {"seed": 1}, 4, "abc"),
    ValidationResult("run", "e-1", "i1", "abc", 4, 2.5, COUNTED, COUNTED),
]


@pytest.mark.parametrize("message", ALL, ids=lambda m: m.KIND)
def test_messages_round_trip(message):
    got, arrays = decode(encode(message, {"x": np.ones(3)}), type(message))
    assert got == message
    assert arrays["x"].sum() == 3


@pytest.mark.parametrize("message", ALL, ids=lambda m: m.KIND)
@settings(max_examples=40)
@given(data=st.data())
def test_a_wrong_field_is_refused_or_valid(message, data):
    body = message.to_dict()
    key = data.draw(st.sampled_from(sorted(body)))
    body[key] = data.draw(plain)
    with contextlib.suppress(MessageError):
        assert type(message).from_dict(body).to_dict().keys() == body.keys()


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (Hello, {"actor_id": "a/b"}),
        (Hello, {"actor_id": "**"}),
        (Hello, {"actor_id": ""}),
        (Hello, {"worlds": 0}),
        (Hello, {"pid": True}),
        (Hello, {"extra": 1}),
        (ChunkHeader, {"sequence": -1}),
        (ChunkHeader, {"timing": {"infer": float("nan")}}),
        (ChunkHeader, {"timing": {"infer": 10**400}}),
        (ChunkHeader, {"episodes": [1]}),
        (Ack, {"status": "fine"}),
        (Ack, {"done": 1}),
        (WeightsAnnouncement, {"version": -2}),
        (WeightsAnnouncement, {"version": 1.0}),
        (EvaluatorHello, {"evaluator_id": "a/b"}),
        (EvaluatorHello, {"ready": 1}),
        (ValidationTask, {"version": -2}),
        (ValidationTask, {"config": []}),
        (ValidationResult, {"version": -1}),
        (ValidationResult, {"seconds": float("nan")}),
        (ValidationResult, {"seconds": 10**400}),
        (ValidationResult, {"seconds": True}),
        (ValidationResult, {"learner_incarnation": ""}),
        (ValidationResult, {"sampled": {**COUNTED, "arrived": 4}}),
        (ValidationResult, {"sampled": {**COUNTED, "arrived": 5, "lost": -1}}),
        (ValidationResult, {"sampled": {**COUNTED, "steps": 5}}),
        (ValidationResult, {"greedy": {**COUNTED, "won": 0}}),
        (ValidationResult, {"greedy": {}}),
    ],
)
def test_wrong_fields_are_refused(kind, change):
    good = next(message for message in ALL if type(message) is kind).to_dict()
    with pytest.raises(MessageError):
        kind.from_dict({**good, **change})


def test_missing_fields_and_other_kinds_are_refused():
    with pytest.raises(MessageError, match="lacks the field"):
        Hello.from_dict({"actor_id": "a"})
    with pytest.raises(MessageError, match="expected ack"):
        decode(encode(ALL[0]), Ack)
    with pytest.raises(MessageError, match="must be a map"):
        Ack.from_dict(None)


def test_digest_tells_blobs_apart():
    assert messages.digest(b"a") != messages.digest(b"b")
    assert len(messages.digest(b"")) == 8
