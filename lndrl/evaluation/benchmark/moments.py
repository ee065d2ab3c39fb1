"""One moment of an episode of the bench, as the robot's network sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.evaluation.benchmark.replay import Drive, Replay
from lndrl.evaluation.benchmark.spec import Contender
from lndrl.navigation import Navigation, WorldSnapshot, dequantise
from lndrl.policy import FirstLayer, first_layer


@dataclass(frozen=True)
class Moment:
    """After ``step`` control steps of ``drive``; ``scan`` (frames * beams,) as it was observed.

    ``scans`` (frames, beams) are its metres, the newest last.
    """

    drive: Drive
    step: int
    snapshot: WorldSnapshot
    scan: NDArray[np.uint16]
    scans: NDArray[np.float32]
    layer: FirstLayer


def need_network(contender: Contender) -> bytes:
    """The weights of ``contender``; raises UserError where it has none."""
    if contender.source.weights is None:
        raise UserError(
            f"method {contender.name} follows a rule and has no network to look into; "
            "name a learned method, a run folder or a weights file"
        )
    return contender.source.weights


def moment_of(replay: Replay, episode: int, step: int | None = None) -> Moment:
    """Drive ``episode`` and look at the network after ``step`` steps, by default halfway.

    Raises UserError for a method without a network and for a step that the episode has not.
    """
    weights = need_network(replay.contender)
    seen: list[tuple[WorldSnapshot, NDArray[np.uint16]]] = []

    def watch(world: Navigation) -> None:
        seen.append((world.snapshot(), world.observation.scan.copy()))

    (drive,) = replay.drive([episode], watch=watch)
    last = len(seen) - 1
    if step is not None and step > last:
        raise UserError(f"step {step}: episode {episode} ended after {last} steps")
    chosen = last // 2 if step is None else step
    snapshot, scan = seen[chosen]
    scans = dequantise(scan, snapshot.range_max).reshape(replay.config.task.scan_frames, -1)
    return Moment(drive, chosen, snapshot, scan, scans, first_layer(replay.config, weights, scan))
