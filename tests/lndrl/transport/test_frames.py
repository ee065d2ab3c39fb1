"""Frames of live worlds: what is sent is small, and what is none is refused."""

from __future__ import annotations

import dataclasses
import zlib
from typing import Any

import numpy as np
import pytest

from lndrl.transport import MessageError
from lndrl.transport.frames import (
    ARRAYS,
    FRAME_LIMITS,
    GRID,
    MOST_CELLS,
    NUMBERS,
    WorldFrame,
    decode_frame,
    encode_frame,
    pack_grid,
    unpack_grid,
)
from lndrl.transport.messages import encode

FIXED = ("pose_true", "pose_estimated", "variance", "start_pose", "goal", "command", "covariance")


def frame(**changes: Any) -> WorldFrame:
    plain = WorldFrame(
        *("run-1", "actor-0", 1, "hall", 0, 7, 12, "", 3, -1, 40, 60, 5),
        numbers=dict.fromkeys(NUMBERS, 1.0),
        part_names=[],
    )
    return dataclasses.replace(plain, **changes)


def arrays(full: bool = False) -> dict[str, np.ndarray]:
    return {
        name: np.ones((most if full or name in FIXED else 0, *shape), np.float32)
        for name, (most, shape) in ARRAYS.items()
    }


def test_the_fullest_frame_fits_into_what_is_taken() -> None:
    rng = np.random.default_rng(0)
    grid = rng.random((620, 620)) < 0.5  # which nothing can compress
    packed = pack_grid(grid)
    assert packed is not None
    names = [f"part-{i}" for i in range(ARRAYS["parts"][0])]
    sent = encode_frame(frame(part_names=names), {**arrays(full=True), GRID: packed})
    assert len(sent) <= FRAME_LIMITS.max_bytes
    found, told = decode_frame(sent)
    assert found == frame(part_names=names) and set(told) == {*ARRAYS, GRID}
    assert (unpack_grid(told[GRID], 620, 620) == grid).all()
    assert pack_grid(rng.random((1200, 1200)) < 0.5) is None, "that would not fit"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"actor_id": "a/b"}, "actor_id"),
        ({"scenario": "x" * 201}, "scenario"),
        ({"steps": -1}, "steps"),
        ({"outcome": None}, "outcome"),
        ({"protocol": 2}, "protocol must be 1"),
        ({"rows": 2**20, "columns": 2**20}, f"at most {MOST_CELLS} cells"),
        ({"numbers": {"time": 1.0}}, "numbers must hold"),
        ({"numbers": {**dict.fromkeys(NUMBERS, 1.0), "time": float("nan")}}, "time must be"),
        ({"numbers": {**dict.fromkeys(NUMBERS, 1.0), "robot_radius": 1e5}}, "robot_radius must"),
        ({"part_names": ["a", 1]}, "part_names"),
    ],
)
def test_a_frame_checks_itself(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(MessageError, match=words):
        frame(**changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"particles": np.ones((257, 3), np.float32)}, "particles has 257 rows"),
        ({"particles": np.ones((4, 2), np.float32)}, "particles must be"),
        ({"goal": np.ones(1, np.float32)}, "goal has 1 rows"),
        ({"scan": np.ones(4)}, "scan must be float32"),
        ({"scan": np.array([np.inf], np.float32)}, "scan must hold numbers"),
        ({"path": np.full((1, 2), 1e9, np.float32)}, "path must hold numbers"),
        ({"weights": np.ones(3, np.float32)}, "as many as particles"),
        ({"parts": np.ones(1, np.float32)}, "as many as their names"),
        ({"probabilities": np.ones(2, np.float32)}, "as many as actions"),
        ({GRID: np.ones((2, 2), np.uint8)}, "grid must be bytes"),
        ({"more": np.ones(1, np.float32)}, "a frame has the arrays"),
    ],
)
def test_arrays_of_other_shapes_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(MessageError, match=words):
        encode_frame(frame(), arrays() | changes)
    with pytest.raises(MessageError, match=words):
        decode_frame(encode(frame(), arrays() | changes))  # from whoever does not check


def test_what_is_too_large_or_no_frame_is_refused() -> None:
    with pytest.raises(MessageError, match="exceeds"):
        decode_frame(bytes(FRAME_LIMITS.max_bytes + 1))
    with pytest.raises(MessageError, match="there is no action 4"):
        encode_frame(frame(action=4), arrays())


def test_a_grid_that_unpacks_to_something_else_is_refused() -> None:
    bomb = np.frombuffer(zlib.compress(bytes(2**24)), np.uint8)
    with pytest.raises(MessageError, match="not 40 x 60 cells"):
        unpack_grid(bomb, 40, 60)
    with pytest.raises(MessageError, match="grid"):
        unpack_grid(np.arange(9, dtype=np.uint8), 40, 60)
