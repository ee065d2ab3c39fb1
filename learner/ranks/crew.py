"""Rank 0's side: it says what is done next, and the others do it (``follower.py``)."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from threading import Event
from typing import Any

from learner.intake.accounts import Accounts
from learner.intake.chunks import Chunk
from learner.intake.ingest import Ingest
from learner.intake.lanes import Lanes
from learner.intake.ledger import ChunkId
from learner.intake.parts import Part
from learner.intake.whole import Whole, books_of
from learner.ppo.team import Team
from learner.ppo.update import PPO
from learner.ranks.alike import digest_of, facts, make_alike
from learner.ranks.haul import exchange, room, shares
from learner.run.checkpoint import Counters
from lndrl.errors import UserError

POLL = 0.02  # s between two looks at what waits on all ranks
_REPORTS = 1.0  # s between two reports for the status

Tell = Callable[[str, str, str | None], None]


class Crew:
    """The other ranks of a learner, as rank 0 has to do with them.

    Every method but the properties tells all of them to do something, and returns when they have.
    Raises UserError once one of them is gone.
    """

    def __init__(self, team: Team) -> None:
        self.team = team
        self.lanes = Lanes(team.rank, team.size)
        self.stop: Event | None = None  # set when another rank is asked to stop
        self._waiting = [0] * team.size
        self._reported = 0.0
        self._listening = True  # the others wait for a word
        self.excused: list[ChunkId] = []  # of what came before, see ``Recovery``
        self._excerpts: list[dict[str, Any]] = []

    def leftovers(self) -> list[Part]:
        """Parts of the ledger that the others' machines hold from before."""
        replies = self._ask("leftovers")
        return [Part(**part) for reply in replies for part in reply["parts"]]

    def begin(self, ppo: PPO, counters: Counters, ingest: Ingest, endpoint: str) -> None:
        """Let the others begin where rank 0 stands, which listens at ``endpoint``."""
        said = facts(ppo)
        word = {
            "counters": asdict(counters),
            "facts": said,
            "run_id": ingest.run_id,
            "incarnation": ingest.incarnation,
            "endpoint": endpoint,
            "newest_version": ingest.newest_version,
            "roster": ingest.roster.to_state(),
            "excused": self.excused,
        }
        self.team.say({"do": "begin", **word})
        make_alike(self.team, ppo, said)
        self.team.gather({})

    def collect(
        self,
        ingest: Ingest,
        whole: Whole,
        batch: int,
        counters: Counters,
        timeout: float,
        tell: Tell,
    ) -> list[Chunk] | None:
        """The chunks of all ranks for an update of ``batch`` samples; None after ``timeout`` s."""
        deadline = time.monotonic() + timeout
        while True:
            self._look(ingest, whole, batch, counters.version, tell)
            if sum(self._waiting) >= batch:
                break
            left = deadline - time.monotonic()
            if left <= 0 or (self.stop is not None and self.stop.is_set()):
                return None
            ingest.wait_for_more(self._waiting[0], min(left, POLL))
        given = shares(self._waiting, batch)
        self._listening = False
        self.team.say({"do": "take", "shares": given, "counters": asdict(counters)})
        return exchange(self.team, ingest.draw(given[0]), ingest.config)

    def updated(self) -> None:
        """The update of what was collected is over, on every rank alike."""
        self._listening = True

    def books(self, ppo: PPO, ingest: Ingest, tell: Tell) -> dict[str, Any]:
        """Roster and accounts of all ranks, for a checkpoint; ``fold`` comes after.

        Rounding may differ from one kind of processor to another. Networks that have drifted
        apart become those of rank 0 again.
        """
        self._excerpts = self._ask("books")
        mine = digest_of(ppo)
        others = [r for r, found in enumerate(self._excerpts, 1) if found["digest"] != mine]
        if others:
            said = facts(ppo)
            self.team.say({"do": "alike", "facts": said})
            make_alike(self.team, ppo, said)
            names = " and ".join(self.team.name(rank) for rank in others)
            tell("ranks", f"{names} rounded otherwise; rank 0's networks count", None)
        return books_of(ingest.to_state(), self._excerpts, self.lanes)

    def fold(self, accounts: Accounts) -> list[dict[str, Any]]:
        """Take into the ledger what the others have noted, as of ``books``; their totals then."""
        parts = [Part(**excerpt["part"]) for excerpt in self._excerpts]
        accounts.fold(parts)
        self.team.say({"do": "folded", "taken": [len(part.lines) for part in parts]})
        return [excerpt["accounts"] for excerpt in self._excerpts]

    def close_books(self, ppo: PPO, ingest: Ingest, tell: Tell) -> None:
        """Take into the ledger what the others have noted to the end."""
        self.books(ppo, ingest, tell)
        self.fold(ingest.accounts)

    def shut(self, whole: Whole) -> None:
        """Let the others accept nothing any more."""
        whole.put([reply["report"] for reply in self._ask("shut")])

    def finish(self) -> None:
        """Let them tell every actor that the run is done."""
        self.team.say({"do": "finish"})

    def leave(self, well: bool) -> None:
        """Let them end; not ``well``: rank 0 has failed and does not know what they have noted."""
        if self._listening:
            self._listening = False
            with suppress(UserError):
                self.team.say({"do": "leave", "well": well})

    def _look(self, ingest: Ingest, whole: Whole, batch: int, version: int, tell: Tell) -> None:
        """Hear from all ranks what waits there, and say how much may."""
        now = time.monotonic()
        reports = now - self._reported >= _REPORTS
        self.team.say({"do": "round", "version": version, "batch": batch, "report": reports})
        mine = ingest.stock(room(self._waiting, 0, batch))
        replies = self.team.gather({"waiting": mine})
        self._waiting = [int(reply["waiting"]) for reply in replies]
        for reply in replies[1:]:
            for kind, text, sender in reply["events"]:
                tell(kind, text, sender)
            if reply["stop"] and self.stop is not None:
                self.stop.set()
        if reports:
            self._reported = now
            whole.put([reply["report"] for reply in replies[1:]])

    def _ask(self, what: str) -> list[dict[str, Any]]:
        """What the others answer, by rank."""
        self.team.say({"do": what})
        return self.team.gather({})[1:]
