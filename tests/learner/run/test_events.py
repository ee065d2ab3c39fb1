"""Records on a disk that refuses, floods, and words that senders choose."""

from __future__ import annotations

import io
import os
import threading
from pathlib import Path
from unittest.mock import patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from learner.run import events as events_module
from learner.run.events import EventLog
from learner.run.flood import _ALL, WINDOW, Flood
from learner.run.lines import LineFile, backwards


class Disk:
    """Stands between the program and ``os.write``; ``room`` bytes are left."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.room: int | None = None
        self._write = os.write
        monkeypatch.setattr("learner.run.lines.os.write", self.write)
        monkeypatch.setattr("learner.run.lines._RETRY", 0.0)

    def write(self, descriptor: int, data: bytes) -> int:
        if self.room is None:
            return self._write(descriptor, data)
        if not self.room:
            raise OSError(28, "No space left on device")
        written = self._write(descriptor, data[: self.room])
        self.room -= written
        return written


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


def test_lines_wait_while_the_disk_is_full_and_none_is_cut(tmp_path: Path, disk: Disk) -> None:
    said: list[OSError | None] = []
    file = LineFile(tmp_path / "a", said.append)
    file.add("one")
    disk.room = 3
    for line in ("two two two", "three", "four"):
        file.add(line)
        assert (tmp_path / "a").read_text() == "one\n", "half a line was taken back"
    (error,) = said
    assert error is not None and error.errno == 28
    disk.room = None
    file.add("five")
    assert (tmp_path / "a").read_text() == "one\ntwo two two\nthree\nfour\nfive\n"
    assert said[1:] == [None]


def test_memory_for_waiting_lines_is_bounded(tmp_path: Path, disk: Disk) -> None:
    file = LineFile(tmp_path / "a", keep=10)
    disk.room = 0
    for n in range(100):
        file.add(str(n))
    assert file.lost == 90 and not file.flush()
    disk.room = None
    assert file.flush()
    assert (tmp_path / "a").read_text().split() == [str(n) for n in range(90, 100)]


def test_closing_writes_what_waits_and_a_later_line_opens_again(tmp_path: Path, disk: Disk) -> None:
    file = LineFile(tmp_path / "a")
    disk.room = 0
    file.add("one")
    disk.room = None
    file.close()
    assert (tmp_path / "a").read_text() == "one\n"
    file.add("two")
    assert (tmp_path / "a").read_text() == "one\ntwo\n"


def test_a_refusing_disk_is_not_tried_for_every_line(
    tmp_path: Path, disk: Disk, monkeypatch
) -> None:
    monkeypatch.setattr("learner.run.lines._RETRY", 60.0)
    tries: list[bytes] = []

    def refuse(_: int, data: bytes) -> int:
        tries.append(data)
        return 0

    monkeypatch.setattr("learner.run.lines.os.write", refuse)
    file = LineFile(tmp_path / "a")
    for _ in range(100):
        file.add("x")
    assert len(tries) == 1


@pytest.mark.parametrize(
    "before", ["", "whole\n", "whole\nhalf", "half", "x" * 10_000 + "\n" + "y" * 9000]
)
def test_what_a_killed_writer_left_is_cut_to_whole_lines(tmp_path: Path, before: str) -> None:
    (tmp_path / "a").write_text(before)
    file = LineFile(tmp_path / "a")
    file.add("next")
    assert (tmp_path / "a").read_text() == before[: before.rfind("\n") + 1] + "next\n"
    file.close()


def test_files_rotate_at_their_limit(tmp_path: Path) -> None:
    file = LineFile(tmp_path / "a", limit=1000)
    for n in range(1000):
        file.add(f"line {n}")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "a.1"]
    assert (tmp_path / "a.1").stat().st_size < 1100
    assert (tmp_path / "a").read_text().endswith("line 999\n")


def test_as_many_older_files_are_kept_as_were_asked_for(tmp_path: Path) -> None:
    file = LineFile(tmp_path / "a", older=3)
    for n in range(6):
        file.add(f"{n}")
        assert file.rotate()
    file.add("6")
    found = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert found == {"a": "6\n", "a.1": "5\n", "a.2": "4\n", "a.3": "3\n"}


@settings(max_examples=200, deadline=None)
@given(lines=st.lists(st.binary(max_size=40)), block=st.integers(1, 30))
def test_lines_backwards_are_those_forwards(lines: list[bytes], block: int) -> None:
    whole = b"\n".join(lines)
    expected = []
    place = 0
    for line in whole.split(b"\n"):
        place += len(line) + 1
        expected.append((min(place, len(whole)), line))
    with patch("learner.run.lines._BLOCK", block):
        assert list(backwards(io.BytesIO(whole))) == expected[::-1]


@pytest.mark.parametrize("place", ["/dev/full", "nowhere/events.log"])
def test_a_log_that_cannot_be_written_raises_nothing(tmp_path: Path, place: str) -> None:
    log = EventLog(tmp_path / place, quiet=True)
    for n in range(5):
        log.add("start", str(n))
    kinds = [event["kind"] for event in log.recent()]
    assert kinds.count("disk") == 1 and kinds.count("start") == 5
    log.close()


def test_a_disk_that_works_again_is_said(tmp_path: Path, disk: Disk) -> None:
    log = EventLog(tmp_path / "events.log", quiet=True)
    disk.room = 0
    log.add("start", "one")
    disk.room = None
    log.add("start", "two")
    texts = [event["text"] for event in log.recent()]
    assert any("cannot be written" in text for text in texts)
    assert any("written again" in text for text in texts)
    assert [line.split()[-1] for line in (tmp_path / "events.log").read_text().splitlines()] == [
        "one",
        "two",
    ]


def test_a_terminal_that_is_gone_raises_nothing(tmp_path: Path, monkeypatch) -> None:
    class Gone:
        def write(self, text: str) -> None:
            raise BrokenPipeError(32, "Broken pipe")

        flush = write

    monkeypatch.setattr(events_module.sys, "stderr", Gone())
    EventLog(tmp_path / "events.log").add("start", "one")
    assert "one" in (tmp_path / "events.log").read_text()


def test_events_are_one_printable_line(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "events.log", quiet=True)
    log.add("refused", "a\n[end] all is well\x1b[2J\r" + "x" * 10_000 + "\ud800", "a")
    (line,) = (tmp_path / "events.log").read_text().splitlines()
    assert "\x1b" not in line and len(line) < 600
    assert log.recent()[0]["text"].startswith("a?[end]")


def test_a_flood_becomes_a_line_with_a_count() -> None:
    flood, told, counts = Flood(), 0, []
    for tick in range(10_000):
        now = tick * 0.01
        counts += flood.counts(now)
        told += flood.admits("refused", "liar", now)
    assert told == 3
    assert len(counts) == pytest.approx(100 / WINDOW, abs=1)
    assert all("more, of liar" in text for _, text in counts)
    assert flood.counts(200.0) and not flood.counts(300.0) and flood.admits("refused", "liar", 301)


def test_a_flood_hides_no_other_sender() -> None:
    flood = Flood()
    for _ in range(1000):
        flood.admits("refused", "liar", 0.0)
    assert flood.admits("refused", "honest", 0.0) and flood.admits("join", "liar", 0.0)


def test_a_flood_under_many_names_is_bounded() -> None:
    flood = Flood()
    told = sum(flood.admits("refused", f"liar-{n}", 0.0) for n in range(100_000))
    assert told == _ALL
    (window,) = flood._windows.values()
    assert len(window.told) <= _ALL and len(window.senders) <= 20
    ((kind, text),) = flood.counts(None)
    assert kind == "refused" and f"{100_000 - _ALL:,} more" in text and "or more" in text


def test_what_was_counted_is_told_by_whoever_looks(tmp_path: Path, monkeypatch) -> None:
    now = [0.0]
    monkeypatch.setattr("learner.run.events.time.monotonic", lambda: now[0])
    log = EventLog(tmp_path / "events.log", quiet=True)
    for _ in range(100):
        log.add("refused", "no", "liar")
    assert len(log.recent()) == 3
    now[0] = 6.0
    assert log.recent()[-1]["text"] == "97 more, of liar"
    log.add("refused", "no", "liar")
    log.close()
    assert (tmp_path / "events.log").read_text().count("more, of liar") == 2


def test_threads_may_add_at_once(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "events.log", quiet=True)

    def work() -> None:
        for n in range(200):
            log.add("start", f"line {n}")

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len((tmp_path / "events.log").read_text().splitlines()) == 800
