"""Uploads: what is checked before one is accepted, and the queue in which they wait."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learner.intake.ledger import ChunkId
from lndrl.config import MOST_WORLDS_PER_ACTOR, RunConfig
from lndrl.navigation import EpisodeRecord, Trajectory
from lndrl.transport import ChunkHeader

_MOST_CHUNKS = 2**31  # of one incarnation: at ten a second, that takes seven years


@dataclass(frozen=True)
class Chunk:
    """An upload that passed the checks; ``size`` is the memory it takes, in bytes."""

    actor_id: str
    incarnation: str
    sequence: int
    actor_index: int
    trajectory: Trajectory
    episodes: list[EpisodeRecord]
    size: int

    @property
    def id(self) -> ChunkId:
        return self.actor_id, self.incarnation, self.sequence

    @property
    def samples(self) -> int:
        return self.trajectory.action.size

    @cached_property  # the whole queue is asked for it, again and again
    def oldest_version(self) -> int:
        return int(self.trajectory.version.min())


def check_chunk(
    header: ChunkHeader, arrays: dict[str, NDArray[Any]], config: RunConfig, newest_version: int
) -> tuple[Trajectory, list[EpisodeRecord]]:
    """What an upload holds, if an honest actor of this run can have sent it.

    ``newest_version``: of the weights that were ever published. Raises ValueError with one
    sentence. Sizes are compared before anything is read or allocated.
    """
    if not 1 <= header.sequence < _MOST_CHUNKS:
        raise ValueError(f"sequence {header.sequence} is not one of an actor that counts from 1")
    if header.steps != config.actor.horizon:
        raise ValueError(f"a chunk of this run has {config.actor.horizon} steps")
    if header.worlds > MOST_WORLDS_PER_ACTOR:
        most = MOST_WORLDS_PER_ACTOR
        raise ValueError(f"a chunk holds at most {most} worlds, not {header.worlds}")
    action = arrays.get("action")
    if action is None or action.shape != (header.steps, header.worlds):
        raise ValueError(
            f"the arrays are not of the {header.steps} steps in {header.worlds} worlds that the "
            "header tells of"
        )
    trajectory = Trajectory.from_arrays(arrays, config)
    newest = int(trajectory.version.max())
    if newest > newest_version:
        raise ValueError(f"weights version {newest} was never published, {newest_version} was")
    ends = np.count_nonzero(trajectory.terminated) + np.count_nonzero(trajectory.truncated)
    if len(header.episodes) > ends:
        raise ValueError(f"{len(header.episodes)} episodes cannot have ended in {ends} steps")
    terms = tuple(config.task.reward.terms)
    return trajectory, [EpisodeRecord.from_dict(episode, terms) for episode in header.episodes]


def memory_of(trajectory: Trajectory, message: int) -> int:
    """Bytes of a trajectory whose arrays lie in a message of so many; people are unpacked."""
    final = trajectory.final_observation
    return message + trajectory.observation.pedestrians.nbytes + final.pedestrians.nbytes


class ChunkQueue:
    """Chunks in the order of their coming. Whoever shares one locks it."""

    def __init__(self) -> None:
        self._chunks: deque[Chunk] = deque()
        self.samples = 0
        self.bytes = 0

    def __len__(self) -> int:
        return len(self._chunks)

    def put(self, chunk: Chunk) -> None:
        """Add, last."""
        self._chunks.append(chunk)
        self.samples += chunk.samples
        self.bytes += chunk.size

    def take(self, samples: int) -> list[Chunk]:
        """The oldest chunks that together hold ``samples``, which must be there."""
        taken: list[Chunk] = []
        while sum(chunk.samples for chunk in taken) < samples:
            taken.append(self._pop(0))
        return taken

    def actors(self) -> int:
        """Of how many actors there is a chunk."""
        return len({chunk.actor_index for chunk in self._chunks})

    def of(self, actor_id: str) -> int:
        """Chunks of one actor."""
        return sum(chunk.actor_id == actor_id for chunk in self._chunks)

    def take_first_of_each(self) -> list[Chunk]:
        """The oldest chunk of every actor, ordered by actor."""
        first = {c.actor_index: place for place, c in reversed(list(enumerate(self._chunks)))}
        taken = [self._pop(place) for place in sorted(first.values(), reverse=True)]
        return sorted(taken, key=lambda chunk: chunk.actor_index)

    def remove(self, wanted: Callable[[Chunk], bool] = lambda chunk: True) -> list[Chunk]:
        """Take out all that are ``wanted``, oldest first."""
        places = [place for place, chunk in enumerate(self._chunks) if wanted(chunk)]
        return [self._pop(place) for place in reversed(places)][::-1]

    def _pop(self, place: int) -> Chunk:
        chunk = self._chunks[place]
        del self._chunks[place]
        self.samples -= chunk.samples
        self.bytes -= chunk.size
        return chunk
