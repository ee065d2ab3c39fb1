"""Driving a policy's episodes once, keeping all that a page about them shows.

The episodes are those of ``lndrl evaluate`` and ``lndrl lost``, in the same blocks, so all three
say the same of the same policy.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.evaluation.benchmark.replay import Camera, Drive
from lndrl.evaluation.benchmark.worst import badness
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.evaluation.lost import Recorder, Trace
from lndrl.evaluation.pool import Work
from lndrl.evaluation.runner import check_complete, driving
from lndrl.navigation import EpisodeRecord, Navigation, WorldSnapshot, dequantise
from lndrl.navigation.families import Family, episode_of
from lndrl.planners import PlannerSource
from lndrl.policy import FirstLayer, act_on_one_thread, first_layer


@dataclass(frozen=True, eq=False)
class Look:
    """What a policy's network was shown at one moment, and its first layer's answer.

    ``scans`` (frames, beams) m, the newest last. ``step`` of ``steps`` control steps.
    """

    episode: int
    step: int
    steps: int
    snapshot: WorldSnapshot
    scans: NDArray[np.float32]
    layer: FirstLayer


@dataclass(frozen=True, eq=False)
class Filmed:
    """``records`` of all episodes, in their order; ``traces`` too, none with a perfect filter.

    ``first`` are the first episodes, ``worst`` the worst, worst first. ``look`` is halfway through
    episode 0; None where the network has no first layer that can be shown, which ``blind`` says.
    """

    records: tuple[EpisodeRecord, ...]
    traces: tuple[Trace, ...]
    first: tuple[Drive, ...]
    worst: tuple[Drive, ...]
    look: Look | None
    blind: str = ""


@dataclass(frozen=True, eq=False)
class Moment:
    """The middle of an episode as a network sees it; ``scan`` as it was observed."""

    step: int
    steps: int
    snapshot: WorldSnapshot
    scan: NDArray[np.uint16]


Shot = tuple[Drive, Trace | None, Moment | None]


def film(
    source: PlannerSource,
    config: RunConfig,
    episodes: int,
    *,
    first: int = 3,
    worst: int = 6,
    workers: int = 0,
    progress: Callable[[EpisodeRecord], None] | None = None,
) -> Filmed:
    """Drive validation episodes 0 to ``episodes`` - 1 of ``config.seed`` and keep what is shown.

    Memory is taken for the ``first`` and ``worst`` drives alone. ``workers`` processes share the
    work, 0 keeps it in this one; the result is the same. ``progress`` gets each record as its
    episode ends, in any order. Ctrl-C leaves no process. Raises UserError as ``evaluate`` does.
    """
    records: list[EpisodeRecord] = []
    traces: list[Trace] = []
    begun: list[Drive] = []
    kept: list[tuple[tuple[tuple[int, float, float], int], Drive]] = []
    moment: Moment | None = None
    with driving(_make_work, (source, config), episodes, workers) as shots:
        for drive, trace, seen in shots:
            records.append(drive.record)
            traces += [trace] if trace is not None else []
            moment = seen or moment
            if drive.episode < first:
                begun.append(drive)
            place = (badness(drive.record), drive.record.world)
            kept = heapq.nsmallest(worst, [*kept, (place, drive)], key=lambda each: each[0])
            if progress is not None:
                progress(drive.record)
    check_complete(records, episodes)
    look, blind = _looked(source, config, moment)
    return Filmed(
        records=tuple(sorted(records, key=lambda record: record.world)),
        traces=tuple(sorted(traces, key=lambda trace: trace.episode)),
        first=tuple(sorted(begun, key=lambda drive: drive.episode)),
        worst=tuple(drive for _, drive in kept),
        look=look,
        blind=blind,
    )


def _looked(
    source: PlannerSource, config: RunConfig, moment: Moment | None
) -> tuple[Look | None, str]:
    if moment is None or source.weights is None:
        return None, "a rule has no network to look into"
    try:
        layer = first_layer(config, source.weights, moment.scan)
    except UserError as error:
        return None, str(error)
    scans = dequantise(moment.scan, moment.snapshot.range_max)
    scans = scans.reshape(config.task.scan_frames, -1)
    return Look(0, moment.step, moment.steps, moment.snapshot, scans, layer), ""


class _Filming:
    """A worker: drives one block after another and keeps what is seen of each episode."""

    def __init__(self, source: PlannerSource, config: RunConfig) -> None:
        self._runner = EpisodeRunner(source, config, family=Family.VALIDATION)
        self._label, self._config = source.label, config

    def __call__(self, episodes: Sequence[int]) -> Iterator[Shot]:
        cameras = {k: Camera() for k in episodes}
        traced = self._config.localization.kind == "amcl"
        recorder = Recorder(episodes, self._config) if traced else None
        seen: list[tuple[WorldSnapshot, NDArray[np.uint16]]] = []

        def watch(world: Navigation) -> None:
            k = episode_of(world.world_id)
            cameras[k](world)
            if recorder is not None:
                recorder(world)
            if k == 0:
                seen.append((world.snapshot(), world.observation.scan.copy()))

        for record in self._runner(episodes, watch):
            k = episode_of(record.world)
            drive = cameras.pop(k).drive(record, self._label, self._config)
            trace = recorder.trace(record) if recorder is not None else None
            yield drive, trace, _middle(seen) if k == 0 else None


def _middle(seen: Sequence[tuple[WorldSnapshot, NDArray[np.uint16]]]) -> Moment:
    steps = len(seen) - 1
    snapshot, scan = seen[steps // 2]
    return Moment(steps // 2, steps, snapshot, scan)


def _make_work(source: PlannerSource, config: RunConfig) -> Work:
    if source.weights is not None:
        act_on_one_thread(config)
    return _Filming(source, config)
