"""Weights kept by whoever stands between a learner and a site's actors: each version comes once.

Knows no network: ``fetch`` gets a version from the learner, and answers when it has it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from lndrl.transport.messages import NO_WEIGHTS, WeightsAnnouncement

KEPT = 4
"""Versions, those of evaluators counted apart: the learner itself keeps two of each."""


@dataclass(frozen=True)
class Found:
    """A learner's answer: what it says of its newest or the wanted weights, and their bytes.

    ``payload`` is empty where the learner no longer has the version; ``size`` are its bytes.
    """

    news: WeightsAnnouncement
    attachment: Any
    payload: Any
    size: int


Reply = Callable[[Found | None], None]
Fetch = Callable[[str, Reply], None]


class WeightsCache:
    """Answers for the learner. Thread-safe; ``fetch(version, reply)`` must return at once.

    Versions are texts, as they are asked for: empty for the newest.
    """

    def __init__(self, fetch: Fetch) -> None:
        self.fetched = 0  # versions, from the learner
        self.served = 0  # answers
        self._fetch = fetch
        self._lock = threading.Lock()
        self._kept: dict[str, Found] = {}
        self._waiting: dict[str, list[Reply]] = {}
        self._newest = NO_WEIGHTS
        self._learner = ""

    def heard(self, news: WeightsAnnouncement) -> None:
        """The learner has announced weights: get them now, before anybody asks."""
        with self._lock:
            if news.learner_incarnation != self._learner:
                # Another learner may have published others under the same numbers.
                self._learner, self._newest = news.learner_incarnation, NO_WEIGHTS
                self._kept.clear()
            self._newest = max(self._newest, news.version)
            wanted = str(self._newest)
            known = wanted in self._kept or wanted in self._waiting
        if news.version != NO_WEIGHTS and not known:
            self._get(wanted, lambda found: None)

    def ask(self, wanted: str, reply: Reply) -> None:
        """Answer with a version as soon as it is here; with None where it cannot be had."""
        with self._lock:
            self.served += 1
        self._get(wanted, reply)

    def _get(self, wanted: str, reply: Reply) -> None:
        with self._lock:
            key = wanted or (str(self._newest) if self._newest != NO_WEIGHTS else "")
            found, first = self._kept.get(key), False
            if found is None and key not in self._waiting and "" in self._waiting:
                # The newest is on its way, asked for before its number was known: it may be this.
                self._waiting[""].append(lambda _: self._get(wanted, reply))
            elif found is None:
                first = key not in self._waiting
                self._waiting.setdefault(key, []).append(self._once_more(reply, wanted))
        if found is not None:
            reply(found)
        elif first:
            self._fetch(key, lambda answer: self._arrived(key, answer))

    def _arrived(self, key: str, found: Found | None) -> None:
        with self._lock:
            replies = self._waiting.pop(key, [])
            if found is not None and found.size:
                self.fetched += 1
                self._keep(key, found)
        for reply in replies:
            reply(found)

    def _keep(self, key: str, found: Found) -> None:
        news = found.news
        if not key and not self._learner:  # asked for before anything was announced
            self._learner, self._newest = news.learner_incarnation, news.version
        if news.learner_incarnation == self._learner:
            self._kept[key or str(news.version)] = found
            while len(self._kept) > KEPT:
                del self._kept[next(iter(self._kept))]

    def _once_more(self, reply: Reply, wanted: str) -> Reply:
        """``reply``; but who asked for the newest gets what is newest when that is gone."""

        def answer(found: Found | None) -> None:
            if not wanted and found is not None and not found.size:
                self.heard(found.news)
                with self._lock:
                    newer = str(self._newest)
                self._get(newer, reply)
                return
            reply(found)

        return answer
