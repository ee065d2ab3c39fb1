"""A walk as a small file: what its pictures need, so that it can be shown before anything runs."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lndrl.navigation.snapshot import WorldSnapshot

BEAMS = 120
"""Echoes that are kept of a scan; a picture in the terminal has no room for more."""
_STILL = ("resolution", "arrive_distance", "field_of_view", "range_max", "pedestrian_radius",
          "leg_radius", "robot_radius")  # fmt: skip
_MOVING = ("time", "pose_true", "pose_estimated", "pedestrian_position")


def walk_bytes(snapshots: Sequence[WorldSnapshot], weights: str) -> bytes:
    """``snapshots`` of one episode, in order, as a file; ``weights``: the digest of who walks."""
    first = snapshots[0]
    scans = np.stack([each.scan for each in snapshots])
    kept: dict[str, Any] = {
        "weights": np.array(weights),
        "size": np.array(first.size),
        "origin": np.array(first.origin),
        "occupied": np.packbits(first.occupied),
        "cells": np.array(first.occupied.shape),
        "goal": first.goal,
        "scan": scans[:, :: max(1, scans.shape[1] // BEAMS)].astype(np.float16),
    }
    for name in _STILL:
        kept[name] = np.float64(getattr(first, name))
    for name in _MOVING:
        kept[name] = np.stack([np.asarray(getattr(each, name), np.float32) for each in snapshots])
    stream = io.BytesIO()
    np.savez_compressed(stream, **kept)
    return stream.getvalue()


def recorded_walk(file: Path) -> tuple[list[WorldSnapshot], str]:
    """The walk in ``file`` and the digest of its weights; no walk where it cannot be read."""
    try:
        with np.load(file) as data:
            kept = {name: data[name] for name in data.files}
            return _snapshots(kept), str(kept["weights"])
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return [], ""


def _snapshots(kept: dict[str, np.ndarray]) -> list[WorldSnapshot]:
    cells = tuple(kept["cells"].tolist())
    occupied = np.unpackbits(kept["occupied"], count=int(np.prod(cells))).reshape(cells) == 1
    still: dict[str, Any] = {name: float(kept[name]) for name in _STILL}
    paths = {name: kept[name][:, :2].astype(float) for name in ("pose_true", "pose_estimated")}
    people = kept["pedestrian_position"].astype(float)
    return [
        WorldSnapshot(
            scenario="",
            size=(float(kept["size"][0]), float(kept["size"][1])),
            occupied=occupied,
            origin=(float(kept["origin"][0]), float(kept["origin"][1])),
            world=0,
            episode=0,
            steps=k,
            time=float(kept["time"][k]),
            outcome="",
            pose_true=kept["pose_true"][k].astype(float),
            pose_estimated=kept["pose_estimated"][k].astype(float),
            variance=np.zeros(3),
            particles=np.zeros((0, 3)),
            start_pose=kept["pose_true"][0].astype(float),
            goal=kept["goal"],
            command=np.zeros(2),
            scan=kept["scan"][k].astype(np.float32),
            pedestrian_position=people[k],
            pedestrian_velocity=np.zeros_like(people[k]),
            leg_position=np.zeros((0, 2)),
            path=paths["pose_true"][: k + 1],
            path_estimated=paths["pose_estimated"][: k + 1],
            episode_return=0.0,
            **still,
        )
        for k in range(len(kept["time"]))
    ]
