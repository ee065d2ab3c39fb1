"""What one actor shows of a world to whoever watches it: one moment, small and bounded.

Frames are asked for by listening to an actor's key, and sent only while somebody does. One that is
lost is none worth sending again: the next one comes.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from lndrl.transport.messages import (
    IDENTIFIER,
    MAX_INTEGER,
    PROTOCOL_VERSION,
    Limits,
    Message,
    MessageError,
    decode,
    encode,
)

FRAMES_PER_SECOND = 10.0
"""The most that an actor sends, however many watch it."""
FRAME_LIMITS = Limits(max_bytes=96 * 2**10, max_head_bytes=8 * 2**10, max_arrays=24)
MOST_GRID_BYTES = 48 * 2**10
"""Of a compressed grid; a larger place is shown coarser."""
MOST_CELLS = 2**24
NUMBERS = (
    *("time", "width", "height", "resolution", "origin_x", "origin_y", "arrive_distance"),
    *("field_of_view", "range_max", "pedestrian_radius", "leg_radius", "robot_radius"),
    *("episode_return", "position_error", "angle_error", "lost_distance", "lost_angle"),
)
"""In m, rad and s, as ``WorldSnapshot`` has them."""
RADII = ("arrive_distance", "pedestrian_radius", "leg_radius", "robot_radius")
MOST_RADIUS, MOST = 20.0, 1e6
"""Of a radius (m), and of any other number: whoever draws a frame fills discs of that size."""
ARRAYS: dict[str, tuple[int, tuple[int, ...]]] = {
    "pose_true": (3, ()),
    "pose_estimated": (3, ()),
    "variance": (3, ()),
    "start_pose": (3, ()),
    "goal": (2, ()),
    "command": (2, ()),
    "covariance": (3, (3,)),
    "particles": (256, (3,)),
    "weights": (256, ()),
    "scan": (180, ()),
    "pedestrian_position": (128, (2,)),
    "path": (256, (2,)),
    "path_estimated": (256, (2,)),
    "parts": (32, ()),
    "actions": (256, (2,)),
    "probabilities": (256, ()),
}
"""float32 arrays of every frame: the most rows, and the shape of one."""
GRID = "grid"
"""Bits of the occupied cells, row 0 at the lowest y, compressed; in some frames only."""
_LONGEST = 200  # letters of a text


@dataclass(frozen=True)
class WorldFrame(Message):
    """World ``world`` of ``actor_id`` at a moment; its ARRAYS travel beside it.

    ``sequence`` counts an actor's frames. ``outcome`` is empty while the episode goes on.
    ``rows`` and ``columns`` are those of the grid, which ``grid_id`` names and every tenth frame
    has. ``action`` is -1 where none was taken.
    """

    KIND: ClassVar[str] = "world"
    run_id: str
    actor_id: str
    sequence: int
    scenario: str
    world: int
    episode: int
    steps: int
    outcome: str
    weights_version: int
    action: int
    rows: int
    columns: int
    grid_id: int
    numbers: dict[str, float]
    part_names: list[str] = field(default_factory=list)
    protocol: int = PROTOCOL_VERSION

    def __post_init__(self) -> None:
        for name in ("run_id", "scenario", "outcome"):
            value = getattr(self, name)
            if not isinstance(value, str) or len(value) > _LONGEST:
                raise MessageError(f"{name} must be a text of at most {_LONGEST} letters")
        if not isinstance(self.actor_id, str) or not IDENTIFIER.match(self.actor_id):
            raise MessageError("actor_id must be 1 to 64 letters, digits, '_', '.', '-'")
        for name in ("sequence", "world", "episode", "steps", "rows", "columns", "grid_id"):
            _whole(name, getattr(self, name))
        for name in ("weights_version", "action"):
            _whole(name, getattr(self, name), -1)
        if self.protocol != PROTOCOL_VERSION:
            raise MessageError(f"protocol must be {PROTOCOL_VERSION}, not {self.protocol!r}")
        if self.rows * self.columns > MOST_CELLS:
            raise MessageError(f"a grid has at most {MOST_CELLS} cells")
        if not isinstance(self.numbers, dict) or set(self.numbers) != set(NUMBERS):
            raise MessageError(f"numbers must hold {', '.join(NUMBERS)}, and nothing else")
        for name, number in self.numbers.items():
            most = MOST_RADIUS if name in RADII else MOST
            if type(number) is not float or not abs(number) <= most:  # false for NaN
                raise MessageError(f"{name} must be a number of at most {most:g}")
        names = self.part_names
        if not isinstance(names, list) or not all(
            isinstance(name, str) and len(name) <= _LONGEST for name in names
        ):
            raise MessageError("part_names must be a list of texts")


def encode_frame(frame: WorldFrame, arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """A frame as bytes; raises MessageError for arrays that are not as ARRAYS says."""
    _check(frame, arrays)
    return encode(frame, arrays)


def decode_frame(data: bytes) -> tuple[WorldFrame, dict[str, NDArray[Any]]]:
    """Frame and arrays; raises MessageError for what ``encode_frame`` would not have written."""
    frame, arrays = decode(data, WorldFrame, limits=FRAME_LIMITS)
    _check(frame, arrays)
    return frame, arrays


def pack_grid(occupied: NDArray[np.bool_]) -> NDArray[np.uint8] | None:
    """What frames carry of a grid; None where it is too large and must be made coarser."""
    packed = zlib.compress(np.packbits(occupied).tobytes(), 6)
    too_large = len(packed) > MOST_GRID_BYTES or occupied.size > MOST_CELLS
    return None if too_large else np.frombuffer(packed, np.uint8)


def unpack_grid(packed: NDArray[np.uint8], rows: int, columns: int) -> NDArray[np.bool_]:
    """The grid (rows, columns); raises MessageError for bytes that are none of that size."""
    size = (rows * columns + 7) // 8
    inflater = zlib.decompressobj()
    try:
        # One more than fits, so that more than that is seen, and no more is ever unpacked.
        bits = inflater.decompress(packed.tobytes(), size + 1)
    except zlib.error as error:
        raise MessageError(f"grid: {error}") from None
    if len(bits) != size or not inflater.eof:
        raise MessageError(f"grid: not {rows} x {columns} cells")
    flat = np.unpackbits(np.frombuffer(bits, np.uint8), count=rows * columns)
    return flat.reshape(rows, columns) == 1


class Watching(Protocol):
    """One actor's frames as they come, until closed."""

    def newest(self) -> tuple[WorldFrame, dict[str, NDArray[Any]]] | None:
        """The newest frame that has come since the last call, if any; never waits.

        Raises UserError for one that cannot be read.
        """
        ...

    def close(self) -> None:
        """Listen no longer; the actor stops sending where nobody else does. Can be called twice."""
        ...


def _check(frame: WorldFrame, arrays: Mapping[str, NDArray[Any]]) -> None:
    if set(arrays) - {GRID} != set(ARRAYS):
        raise MessageError(f"a frame has the arrays {', '.join(ARRAYS)}, and at most {GRID}")
    for name, (most, shape) in ARRAYS.items():
        array = arrays[name]
        if array.dtype != np.float32 or array.shape[1:] != shape or array.ndim == 0:
            raise MessageError(f"{name} must be float32 of the shape (n, {shape})")
        exact = name in ("pose_true", "pose_estimated", "variance", "start_pose", "goal", "command")
        if len(array) > most or ((exact or name == "covariance") and len(array) != most):
            raise MessageError(f"{name} has {len(array)} rows; {most} is the most")
        if not (np.abs(array) <= MOST).all():  # false for NaN
            raise MessageError(f"{name} must hold numbers of at most {MOST:g}")
    if len(arrays["weights"]) not in (0, len(arrays["particles"])):
        raise MessageError("weights must be as many as particles")
    if len(arrays["parts"]) != len(frame.part_names):
        raise MessageError("parts must be as many as their names")
    if len(arrays["probabilities"]) not in (0, len(arrays["actions"])):
        raise MessageError("probabilities must be as many as actions")
    if frame.action >= len(arrays["actions"]):
        raise MessageError(f"there is no action {frame.action}")
    if GRID in arrays and (arrays[GRID].dtype != np.uint8 or arrays[GRID].ndim != 1):
        raise MessageError("grid must be bytes")


def _whole(name: str, value: Any, least: int = 0) -> None:
    if type(value) is not int or not least <= value < MAX_INTEGER:
        raise MessageError(f"{name} must be a whole number of at least {least}")
