"""A learner of two ranks: the other one is a process, this one is led by the test."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from learner.intake.lanes import Lanes, lane_of
from learner.learner import Learner
from learner.ppo.team import Team
from learner.ranks.agree import Asked, lead
from learner.ranks.crew import Crew
from learner.ranks.local import LocalRanks
from lndrl.config import RunConfig
from lndrl.transport import (
    ActorEndpoint,
    ChunkHeader,
    Hello,
    free_endpoint,
    open_actor,
    open_learner,
)
from lndrl.version import VERSION
from tests.learner.helpers_learner import random_trajectory, small_config

RANKS = 2
LANES = Lanes(0, RANKS)
NAMES = [
    next(f"a{n}" for n in range(100) if LANES.rank_of(f"a{n}") == rank) for rank in range(RANKS)
]
"""Of an actor in the lane of each rank."""


def ranks_config(**changes) -> RunConfig:
    """A small run at a port of its own."""
    changes = {"learner": {"checkpoint_interval": 2}, **changes}
    return small_config(**changes, transport={"endpoint": free_endpoint()})


class Feeder:
    """An actor that sends what it is told to."""

    def __init__(self, config: RunConfig, name: str, life: str = "life") -> None:
        self.config, self.name, self.life = config, name, life
        self.sequence = 0
        self.endpoint: ActorEndpoint = open_actor(config.transport.endpoint, config.transport)
        self.welcome = self.endpoint.hello(Hello(name, life, "host", 1, 2, VERSION), 20.0)

    def send(self, version: int = 0, sequence: int | None = None) -> str:
        """Send one chunk of 16 samples; how it was answered."""
        self.sequence = sequence or self.sequence + 1
        trajectory = random_trajectory(self.config, self.sequence, version=version)
        header = ChunkHeader(self.welcome.run_id, self.name, self.life, self.sequence, 8, 2)
        self.endpoint.upload(header, trajectory.to_arrays(), 20.0)
        assert self.endpoint.flush(20.0)
        return self.endpoint.acks()[-1].status


class Job:
    """Rank 0 of a learner, in this process."""

    def __init__(self, config: RunConfig, path: Path, team: Team, resume: bool = False) -> None:
        self.config = config
        lead(team, config, path, Asked(config))
        self.door = open_learner(config.transport, lane=lane_of(0))
        self.crew = Crew(team)
        self.learner = Learner(config, path, self.door, resume, quiet=True, crew=self.crew)
        self.learner.begin()

    def update(self, feeders: list[Feeder], version: int) -> None:
        """One update on a chunk of each."""
        for feeder in feeders:
            assert feeder.send(version) == "accepted"
        assert self.learner.advance(timeout=20.0)


@contextmanager
def job(config: RunConfig, path: Path, resume: bool = False) -> Iterator[tuple[Job, LocalRanks]]:
    """A job of two ranks that ends with the block; the second rank's process is in the other."""
    ranks = LocalRanks(RANKS)
    with ranks as team:
        made = Job(config, path, team, resume)
        well = False
        try:
            yield made, ranks
            well = True
        finally:
            made.learner.close()
            made.crew.leave(well)
            made.door.close()
