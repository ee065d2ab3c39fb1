"""The side of the ranks other than 0: each does what rank 0 says, and takes in its lane."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any

from learner.intake.accounts import Accounts
from learner.intake.ingest import Ingest
from learner.intake.lanes import Lanes, lane_of
from learner.intake.parts import PartLedger, parts_in, remove_parts
from learner.intake.roster import Roster
from learner.intake.whole import report
from learner.memory import MemoryTide, keep_freed_memory
from learner.ppo.batch import assemble
from learner.ppo.example.stage import stage_of
from learner.ppo.rollout_store import RolloutStore
from learner.ppo.team import Team
from learner.ppo.update import PPO, DivergedError
from learner.ranks.alike import digest_of, make_alike
from learner.ranks.haul import exchange, room
from learner.run.checkpoint import Counters
from learner.run.events import EventLog
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.transport import RankEndpoint, Security, open_rank, reachable

_MOST_EVENTS = 100  # between two words with rank 0
_SAID_BY_RANK_0 = ("join", "leave")

Word = dict[str, Any]


class Follower:
    """One rank of a learner of several, from the moment on that all agree on ``config``.

    Args:
        team: the ranks.
        path: folder of the run, where its part of the ledger lies meanwhile.
        security: the learner's; by it this rank joins rank 0.
        stop: set when this rank is asked to stop; all of them end in order then.
    """

    def __init__(
        self,
        team: Team,
        config: RunConfig,
        path: Path,
        security: Security | None = None,
        stop: Event | None = None,
    ) -> None:
        keep_freed_memory()
        self.team, self.config, self.path = team, config, path
        self.counters = Counters()
        self._security, self._stop = security, stop or Event()
        self._events = _Relay()
        self._waiting = [0] * team.size
        self.ppo = PPO(config, team=team)
        self.store = RolloutStore(pinned=self.ppo.device.type == "cuda")
        self._memory = MemoryTide(self.ppo.each_thread)
        self.ingest: Ingest | None = None
        self._endpoint: RankEndpoint | None = None

    def run(self) -> None:
        """Do what rank 0 says until it says that all is over; raises UserError when it is gone."""
        while True:
            word = self.team.hear()
            getattr(self, f"_do_{word['do']}")(word)
            if word["do"] == "leave":
                return

    def close(self) -> None:
        """Release threads and connections."""
        if self._endpoint is not None:
            self._endpoint.close()
        self.ppo.close()

    # -- what rank 0 may say -------------------------------------------------------------------

    def _do_leftovers(self, word: Word) -> None:
        self.team.gather({"parts": [vars(part) for part in parts_in(self.path)]})

    def _do_begin(self, word: Word) -> None:
        """Begin where rank 0 stands."""
        self.counters = Counters(**word["counters"])
        make_alike(self.team, self.ppo, word["facts"])
        remove_parts(self.path)
        self.team.gather({})  # none makes its part before all have looked
        roster = Roster()
        roster.restore(word["roster"])
        roster.reconcile([], [(a, life, n) for a, life, n in word["excused"]])
        transport = self.config.transport.model_copy(
            update={"endpoint": self._rank_0_at(word["endpoint"])}
        )
        endpoint = open_rank(
            transport, lane_of(self.team.rank), word["incarnation"], self._joining()
        )
        self._endpoint = endpoint
        self.ingest = Ingest(
            *(self.config, word["run_id"], word["incarnation"], roster, self._events),
            Accounts(PartLedger(self.path, self.team.rank)),
            endpoint.largest_message,
            Lanes(self.team.rank, self.team.size),
        )
        self.ingest.newest_version = word["newest_version"]
        self._note_version(self.counters.version)
        endpoint.start(self.ingest)

    def _do_round(self, word: Word) -> None:
        """Say what waits here."""
        ingest = self._intake()
        self._memory.turn()
        self._note_version(word["version"])
        mine = ingest.stock(room(self._waiting, self.team.rank, word["batch"]))
        told = {"waiting": mine, "stop": self._stop.is_set(), "events": self._events.taken()}
        said = self._report(ingest) if word["report"] else None
        replies = self.team.gather({**told, "report": said})
        self._waiting = [int(reply["waiting"]) for reply in replies]

    def _do_take(self, word: Word) -> None:
        """Train on what all ranks have."""
        ingest = self._intake()
        self.counters = counters = Counters(**word["counters"])
        mine = ingest.draw(word["shares"][self.team.rank])
        chunks = exchange(self.team, mine, self.config)
        batch = assemble([chunk.trajectory for chunk in chunks], self.store)
        progress = min(1.0, counters.steps / self.config.learner.total_steps)
        ids = [chunk.id for chunk in mine]
        try:
            self.ppo.update(batch, progress, stage_of(self.config, counters.steps))
        except DivergedError:  # rank 0 has it too, and says so
            ingest.accounts.drop("diverged", ids)
        else:
            ingest.accounts.train(counters.updates + 1, ids)
            # Rank 0 publishes now, and actors may be sooner here with it than its next word.
            ingest.newest_version = max(ingest.newest_version, counters.updates + 1)

    def _do_books(self, word: Word) -> None:
        self.team.gather({**self._intake().excerpt(), "digest": digest_of(self.ppo)})

    def _do_alike(self, word: Word) -> None:
        make_alike(self.team, self.ppo, word["facts"])

    def _do_folded(self, word: Word) -> None:
        self._intake().accounts.begin_part(word["taken"][self.team.rank - 1])

    def _do_shut(self, word: Word) -> None:
        ingest = self._intake()
        ingest.close()
        self.team.gather({"report": self._report(ingest)})

    def _do_finish(self, word: Word) -> None:
        self._intake().finish()
        assert self._endpoint is not None
        self._endpoint.finish()

    def _do_leave(self, word: Word) -> None:
        if word["well"] and self.ingest is not None:
            self.ingest.accounts.leave()

    # -- small steps ---------------------------------------------------------------------------

    def _intake(self) -> Ingest:
        assert self.ingest is not None, "rank 0 has not said begin"
        return self.ingest

    def _report(self, ingest: Ingest) -> dict[str, Any]:
        assert self._endpoint is not None
        return report(ingest, self._endpoint.traffic.counts())

    def _note_version(self, version: int) -> None:
        self._intake().weights_version = version
        assert self._endpoint is not None
        self._endpoint.note_version(version)

    def _rank_0_at(self, endpoint: str) -> str:
        """Where rank 0, which listens at ``endpoint``, is from here."""
        near = self.team.hosts[0] == self.team.hosts[self.team.rank]
        return reachable(endpoint, "" if near else os.environ.get("MASTER_ADDR", ""))

    def _joining(self) -> Security | None:
        """This rank as a client of rank 0, or of the router."""
        security = self._security
        if security is None or self.config.transport.router:
            return security
        found = security.of_local("learner")
        return found if found is not None else replace(security, users=None, overlay=None)


class _Relay(EventLog):
    """Keeps events for rank 0, which says them."""

    def __init__(self) -> None:
        super().__init__(None, quiet=True)
        self._kept: list[tuple[str, str, str | None]] = []

    def add(self, kind: str, text: str, sender: str | None = None) -> None:
        """See ``EventLog``; who comes and goes rank 0 sees for itself."""
        if kind not in _SAID_BY_RANK_0:
            with self._lock:
                self._kept = [*self._kept, (kind, text, sender)][-_MOST_EVENTS:]

    def taken(self) -> list[tuple[str, str, str | None]]:
        """What was added since the last call."""
        with self._lock:
            kept, self._kept = self._kept, []
        return kept


def run_follower(
    team: Team, config: RunConfig, path: Path, security: Security | None, stop: Event
) -> None:
    """Serve as a rank other than 0 until rank 0 says that all is over; raises UserError."""
    if team.rank == 0:
        raise UserError("rank 0 leads")
    follower = Follower(team, config, path, security, stop)
    try:
        follower.run()
    finally:
        follower.close()
