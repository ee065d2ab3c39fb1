"""What all ranks of a learner have taken in, together; of a single one, what that one has."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from learner.intake.accounts import joined, summed
from learner.intake.ingest import Ingest
from learner.intake.lanes import Lanes
from lndrl.transport.status import shares_of
from lndrl.transport.traffic import traffic_of

_DELIVERED = ("last_ack_age", "lag", "steps", "rate", "time_split", "machine")
"""What of an actor's row only the rank knows that takes in its uploads."""


class Whole:
    """Rank 0's own ``ingest`` and the newest reports of the others."""

    def __init__(self, ingest: Ingest) -> None:
        self._ingest = ingest
        self._reports: list[dict[str, Any]] = []
        self._heard = time.monotonic()

    def put(self, reports: Sequence[dict[str, Any]]) -> None:
        """What the other ranks say now; see ``report``."""
        self._reports, self._heard = list(reports), time.monotonic()

    def rates(self) -> dict[str, float]:
        """Samples per second by window, e.g. "60s"."""
        return self._sum("rates", self._ingest.rates.all())

    def dropped(self) -> dict[str, int]:
        """See ``Ingest.dropped``."""
        return self._sum("dropped", self._ingest.dropped)

    def waiting(self) -> dict[str, float]:
        """See ``Ingest.waiting``."""
        return self._sum("waiting", self._ingest.waiting())

    def traffic(self, own: dict[str, float]) -> dict[str, object]:
        """See ``Traffic.counts``; ``own`` are those of rank 0's endpoint."""
        return traffic_of(self._sum("traffic", own))

    def accounts(self) -> dict[str, Any]:
        """See ``Accounts.totals``."""
        own = self._ingest.accounts.totals()
        if not self._reports:
            return own
        return summed([own, *(report["accounts"] for report in self._reports)])

    def actor_shares(self, window: float | None = None) -> dict[str, float]:
        """See ``Roster.shares``; of other ranks always those of their last minute."""
        roster = self._ingest.roster
        own = roster.seconds() if window is None else roster.seconds(window)
        return shares_of(self._sum("actor_seconds", own))

    def actor_totals(self) -> dict[str, float]:
        """See ``Roster.totals``."""
        return self._sum("totals", self._ingest.roster.totals())

    def actor_steps(self) -> int:
        """See ``Roster.steps``."""
        return self._ingest.roster.steps() + sum(int(r["steps"]) for r in self._reports)

    def rows(self, weights_version: int) -> list[dict[str, Any]]:
        """See ``Roster.rows``. Everybody says hello to rank 0, which so knows who lives."""
        rows = self._ingest.roster.rows(weights_version)
        if not self._reports:
            return rows
        late = time.monotonic() - self._heard
        known = {row["id"]: row for row in rows}
        for row in (row for report in self._reports for row in report["rows"]):
            if row["last_ack_age"] is None:
                continue
            told = {**row, "last_ack_age": row["last_ack_age"] + late}
            mine = known.setdefault(row["id"], told)
            mine.update({name: told[name] for name in _DELIVERED})
            if "gone" not in (mine["state"], told["state"]):
                mine["state"] = told["state"]
        return list(known.values())

    def _sum(self, name: str, own: dict[str, Any]) -> dict[str, Any]:
        total = dict(own)
        for report in self._reports:
            for key, value in report[name].items():
                total[key] = total.get(key, 0) + value
        return total


def report(ingest: Ingest, traffic: dict[str, float]) -> dict[str, Any]:
    """What a rank other than 0 says for the whole, plain data; ``traffic`` is its endpoint's."""
    roster = ingest.roster
    return {
        "rows": roster.rows(ingest.weights_version),
        "actor_seconds": roster.seconds(),
        "totals": roster.totals(),
        "steps": roster.steps(),
        "rates": ingest.rates.all(),
        "dropped": ingest.dropped,
        "waiting": ingest.waiting(),
        "accounts": ingest.accounts.totals(),
        "traffic": traffic,
    }


def books_of(own: dict[str, Any], others: Sequence[dict[str, Any]], lanes: Lanes) -> dict[str, Any]:
    """What ``Ingest.to_state`` says on all ranks, as that of one; ``own`` is rank 0's.

    Of each actor's uploads counts what the rank knows that takes them in.
    """
    rosters = [own["roster"], *(each["roster"] for each in others)]
    actors = dict(own["roster"]["actors"])
    following = int(own["roster"]["next_index"])
    for name in (name for roster in rosters[1:] for name in roster["actors"]):
        if name not in actors:
            actors[name], following = following, following + 1
    sequences = [
        entry
        for rank, roster in enumerate(rosters)
        for entry in roster["sequences"]
        if lanes.rank_of(entry[0]) == rank
    ]
    roster = {"actors": actors, "next_index": following, "sequences": sequences}
    accounts = [own["accounts"], *(each["accounts"] for each in others)]
    return {"roster": roster, "accounts": joined(accounts)}
