"""Weights at a site: each version is asked for once, whoever wants it and whenever."""

from __future__ import annotations

from lndrl.transport import WeightsAnnouncement
from lndrl.transport.caching import KEPT, Found, Reply, WeightsCache


class Learner:
    """Keeps questions open until they are answered by hand."""

    def __init__(self) -> None:
        self.open: list[tuple[str, Reply]] = []
        self.asked: list[str] = []
        self.cache = WeightsCache(self._fetch)

    def _fetch(self, wanted: str, reply: Reply) -> None:
        self.asked.append(wanted)
        self.open.append((wanted, reply))

    def announce(self, version: int, learner: str = "one") -> None:
        self.cache.heard(WeightsAnnouncement(version, 3, "d", learner))

    def answer(self, version: int, blob: bytes = b"abc", learner: str = "one") -> None:
        _, reply = self.open.pop(0)
        news = WeightsAnnouncement(version, len(blob), "d", learner)
        reply(Found(news, b"", blob, len(blob)))


class Asker:
    def __init__(self, learner: Learner, wanted: str = "") -> None:
        self.got: list[Found | None] = []
        learner.cache.ask(wanted, self.got.append)

    @property
    def version(self) -> int | None:
        (found,) = self.got
        return found.news.version if found is not None else None


def test_what_is_announced_comes_once_for_all() -> None:
    learner = Learner()
    learner.announce(7)
    early = [Asker(learner), Asker(learner), Asker(learner, "7")]
    learner.announce(7)
    assert learner.asked == ["7"] and not any(asker.got for asker in early)
    learner.answer(7)
    late = Asker(learner)
    assert [asker.version for asker in (*early, late)] == [7] * 4
    assert learner.asked == ["7"]
    assert (learner.cache.fetched, learner.cache.served) == (1, 4)


def test_the_newest_is_waited_for() -> None:
    learner = Learner()
    learner.announce(7)
    learner.answer(7)
    learner.announce(8)
    asker, older = Asker(learner), Asker(learner, "7")
    assert not asker.got and older.version == 7
    learner.answer(8)
    assert asker.version == 8


def test_a_failed_fetch_is_told_and_tried_again() -> None:
    learner = Learner()
    learner.announce(7)
    asker = Asker(learner)
    learner.open.pop(0)[1](None)
    assert asker.got == [None]
    learner.announce(7)
    assert learner.asked == ["7", "7"]


def test_another_learner_has_other_weights_under_the_same_number() -> None:
    learner = Learner()
    learner.announce(7)
    learner.answer(7, b"old")
    learner.announce(7, "two")
    asker = Asker(learner)
    learner.answer(7, b"new", "two")
    assert asker.got[0] is not None and asker.got[0].payload == b"new"


def test_weights_of_a_learner_that_went_meanwhile_are_not_kept() -> None:
    learner = Learner()
    learner.announce(7)
    learner.announce(2, "two")
    learner.answer(7, b"old", "one")
    asker = Asker(learner)
    assert not asker.got
    learner.answer(2, b"new", "two")
    assert asker.version == 2


def test_who_wants_the_newest_gets_it_when_the_version_is_gone() -> None:
    learner = Learner()
    learner.announce(7)
    newest, exact = Asker(learner), Asker(learner, "7")
    learner.answer(9, b"")
    assert exact.version == 9 and exact.got[0] is not None and exact.got[0].size == 0
    assert not newest.got and learner.asked == ["7", "9"]
    learner.answer(9)
    assert newest.version == 9


def test_before_the_first_announcement_the_learner_is_asked() -> None:
    learner = Learner()
    asker = Asker(learner)
    assert learner.asked == [""]
    learner.answer(3)
    assert asker.version == 3 and Asker(learner).version == 3
    learner.announce(3)
    assert learner.asked == [""] and Asker(learner, "3").version == 3


def test_only_the_newest_are_kept() -> None:
    learner = Learner()
    for version in range(1, KEPT + 3):
        learner.announce(version)
        learner.answer(version)
    asked = len(learner.asked)
    assert Asker(learner, str(KEPT + 2)).version == KEPT + 2
    Asker(learner, "1")
    assert learner.asked[asked:] == ["1"]


def test_what_was_asked_for_before_it_had_a_number_does_not_come_twice() -> None:
    learner = Learner()
    early = Asker(learner)
    learner.announce(7)
    late, named = Asker(learner), Asker(learner, "7")
    assert learner.asked == [""]
    learner.answer(7)
    assert [asker.version for asker in (early, late, named)] == [7] * 3
    assert learner.asked == [""] and learner.cache.fetched == 1


def test_the_newest_that_came_may_be_older_than_what_was_announced_meanwhile() -> None:
    learner = Learner()
    early = Asker(learner)
    learner.announce(8)
    named = Asker(learner, "8")
    learner.answer(7)
    assert early.version == 7 and not named.got and learner.asked == ["", "8"]
    learner.answer(8)
    assert named.version == 8


def test_whoever_waited_for_a_failed_answer_asks_again() -> None:
    learner = Learner()
    early = Asker(learner)
    learner.announce(7)
    named = Asker(learner, "7")
    learner.open.pop(0)[1](None)
    assert early.got == [None] and not named.got
    learner.answer(7)
    assert named.version == 7 and learner.asked == ["", "7"]
