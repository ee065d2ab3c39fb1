"""What every rank has taken in for an update, brought to all of them.

A batch is a tenth of what the gradients of one step are: that all ranks hold all of it costs
little, and each can evaluate an equal share of every minibatch, whoever took in how much.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from learner.intake.chunks import Chunk
from learner.ppo.team import Team
from lndrl.config import RunConfig
from lndrl.navigation import EpisodeRecord, Trajectory
from lndrl.transport import pack, unpack

_LENGTH = 8  # bytes before each chunk


def shares(waiting: Sequence[int], wanted: int) -> list[int]:
    """How many of ``wanted`` samples each rank gives, of those that wait at it.

    Alike as far as there are enough; what one lacks, the others give.
    """
    given = [0] * len(waiting)
    while (missing := wanted - sum(given)) > 0:
        left = [rank for rank, count in enumerate(waiting) if count > given[rank]]
        for rank in left:
            given[rank] = min(waiting[rank], given[rank] - (-missing // len(left)))
    return given


def room(waiting: Sequence[int], rank: int, batch: int) -> int:
    """Samples that may wait at ``rank``: what the others lack of a batch, or its share of one."""
    others = sum(waiting) - waiting[rank]
    return max(batch - others, -(-batch // len(waiting)))


def exchange(team: Team, own: Sequence[Chunk], config: RunConfig) -> list[Chunk]:
    """The chunks of all ranks, by rank; ``own`` are this one's."""
    found: list[Chunk] = []
    for rank, data in enumerate(team.gather_bytes(b"".join(_packed(own)))):
        found += own if rank == team.rank else _unpacked(data, config)
    return found


def _packed(chunks: Sequence[Chunk]) -> Iterator[bytes]:
    for chunk in chunks:
        header = {
            "id": list(chunk.id),
            "index": chunk.actor_index,
            "size": chunk.size,
            "episodes": [episode.to_dict() for episode in chunk.episodes],
        }
        data = pack(header, chunk.trajectory.to_arrays())
        yield len(data).to_bytes(_LENGTH, "little")
        yield data


def _unpacked(data: bytes, config: RunConfig) -> Iterator[Chunk]:
    view, terms = memoryview(data), tuple(config.task.reward.terms)
    while view:
        end = _LENGTH + int.from_bytes(view[:_LENGTH], "little")
        header, arrays = unpack(view[_LENGTH:end])
        view = view[end:]
        actor, life, sequence = header["id"]
        yield Chunk(
            *(actor, life, sequence, header["index"]),
            Trajectory.from_arrays(arrays, config),
            [EpisodeRecord.from_dict(episode, terms) for episode in header["episodes"]],
            header["size"],
        )
