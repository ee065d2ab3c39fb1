"""Snapshots as frames of ``lndrl.transport.frames``, thinned to what a screen can show."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.navigation.snapshot import WorldSnapshot
from lndrl.transport.frames import (
    ARRAYS,
    GRID,
    MOST,
    MOST_RADIUS,
    NUMBERS,
    RADII,
    WorldFrame,
    encode_frame,
    pack_grid,
    unpack_grid,
)

GRID_EVERY = 10
"""Frames of which one carries the grid: whoever comes in between waits a second for it."""
_PLACED = ("width", "height", "origin_x", "origin_y", "resolution")


class Framer:
    """Makes one actor's frames; keeps the grid that it has packed, which seldom changes."""

    def __init__(self, run_id: str, actor_id: str) -> None:
        self._run_id, self._actor_id = run_id[:200], actor_id
        self._sequence = 0
        self._since_grid = GRID_EVERY
        self._place: tuple[str, int] = ("", -1)
        self._grid = np.zeros(0, np.uint8)
        self._cells: tuple[int, int, float] = (0, 0, 1.0)  # rows, columns, resolution as packed
        self._grid_id = 0

    def frame(self, snapshot: WorldSnapshot, version: int, layout: int = 0) -> bytes:
        """``snapshot`` encoded; ``layout`` tells places of one scenario apart."""
        if (snapshot.scenario, layout) != self._place:
            self._pack(snapshot)
            self._place, self._since_grid = (snapshot.scenario, layout), GRID_EVERY
        self._sequence += 1
        self._since_grid += 1
        rows, columns, resolution = self._cells
        frame = WorldFrame(
            run_id=self._run_id,
            actor_id=self._actor_id,
            sequence=self._sequence,
            scenario=snapshot.scenario[:200],
            world=snapshot.world,
            episode=snapshot.episode,
            steps=snapshot.steps,
            outcome=snapshot.outcome,
            weights_version=version,
            action=snapshot.action,
            rows=rows,
            columns=columns,
            grid_id=self._grid_id,
            numbers=_numbers(snapshot, resolution),
            part_names=[name[:200] for name in snapshot.part_names[: ARRAYS["parts"][0]]],
        )
        arrays: dict[str, NDArray[Any]] = {
            name: _thinned(getattr(snapshot, name), name) for name in ARRAYS
        }
        if len(snapshot.weights):
            arrays["weights"] = _thinned(snapshot.weights, "particles")
        if self._since_grid >= GRID_EVERY:
            arrays[GRID], self._since_grid = self._grid, 0
        return encode_frame(frame, arrays)

    def _pack(self, snapshot: WorldSnapshot) -> None:
        occupied, resolution = snapshot.occupied, snapshot.resolution
        while (packed := pack_grid(occupied)) is None:
            rows, columns = (n - n % 2 for n in occupied.shape)
            halves = occupied[:rows, :columns].reshape(rows // 2, 2, columns // 2, 2)
            occupied = np.asarray(halves.any(axis=(1, 3)))
            resolution *= 2.0
        self._grid, self._cells = packed, (*occupied.shape, resolution)
        self._grid_id = zlib.crc32(packed.tobytes())


def snapshot_of(
    frame: WorldFrame, arrays: Mapping[str, NDArray[Any]], grid: NDArray[np.bool_]
) -> WorldSnapshot:
    """The moment that a frame shows, as far as it was sent; ``grid`` (rows, columns)."""
    numbers: dict[str, Any] = {n: frame.numbers[n] for n in NUMBERS if n not in _PLACED}
    places: dict[str, Any] = {
        name: arrays[name].astype(np.float64) for name in ARRAYS if name != "scan"
    }
    people = len(places["pedestrian_position"])
    return WorldSnapshot(
        scenario=frame.scenario,
        size=(frame.numbers["width"], frame.numbers["height"]),
        occupied=grid,
        resolution=frame.numbers["resolution"],
        origin=(frame.numbers["origin_x"], frame.numbers["origin_y"]),
        world=frame.world,
        episode=frame.episode,
        steps=frame.steps,
        outcome=frame.outcome,
        scan=arrays["scan"].astype(np.float32),
        pedestrian_velocity=np.zeros((people, 2)),
        leg_position=np.zeros((0, 2)),
        part_names=tuple(frame.part_names),
        action=frame.action,
        **numbers,
        **places,
    )


def grid_of(frame: WorldFrame, arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_] | None:
    """The grid of a frame that carries it; raises MessageError for one that is none."""
    return unpack_grid(arrays[GRID], frame.rows, frame.columns) if GRID in arrays else None


def _numbers(snapshot: WorldSnapshot, resolution: float) -> dict[str, float]:
    placed = {
        "width": snapshot.size[0],
        "height": snapshot.size[1],
        "origin_x": snapshot.origin[0],
        "origin_y": snapshot.origin[1],
        "resolution": resolution,
    }
    found = {name: placed.get(name, getattr(snapshot, name, 0.0)) for name in NUMBERS}
    most = {name: MOST_RADIUS if name in RADII else MOST for name in NUMBERS}
    return {name: float(np.clip(number, -most[name], most[name])) for name, number in found.items()}


def _thinned(values: NDArray[Any], name: str) -> NDArray[np.float32]:
    """At most as many rows as frames have; of a path, whose end matters, always the last."""
    most = ARRAYS[name][0]
    if name == "parts":
        values = values[:most]
    if len(values) > most:
        # Whole strides keep a scan's beams at equal angles; what goes beyond falls at the end.
        stride = -(-len(values) // most)
        start = (len(values) - 1) % stride if name.startswith("path") else 0
        values = values[start::stride]
    return np.ascontiguousarray(np.clip(values, -MOST, MOST), dtype=np.float32)
