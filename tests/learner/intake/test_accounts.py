"""Every acknowledged chunk ends as trained or dropped, through crashes and damage."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from learner.intake.accounts import Accounts, Recovery
from learner.intake.ledger import FILES, RULES, ChunkId, Ledger, newest_totals
from learner.intake.roster import Roster

A, B = ("a", "x", 1), ("b", "y", 1)


def rows(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()]


class Books:
    """Roster, accounts and a queue as a learner has them, that can die and come back."""

    def __init__(self, path: Path, limit: int = 2**20) -> None:
        self.path, self.limit = path, limit
        self.saved: list[tuple[int, str]] = []
        self.update = 0
        self._begin()
        self.checkpoint()

    def _begin(self) -> None:
        self.roster = Roster()
        self.queue: list[ChunkId] = []
        self.accounts = Accounts(Ledger(self.path, limit=self.limit))

    def accept(self, chunk: ChunkId, samples: int = 10) -> bool:
        if self.roster.is_known(*chunk):
            return False
        self.roster.join(chunk[0], chunk[1], "host", 1, 2)
        self.accounts.accept(chunk, samples)
        self.gaps = self.roster.accepted(*chunk, samples, 0, {})
        self.queue.append(chunk)
        return True

    def train(self, count: int) -> list[ChunkId]:
        taken, self.queue = self.queue[:count], self.queue[count:]
        self.update += 1
        self.accounts.train(self.update, taken)
        return taken

    def drop(self, rule: str, count: int) -> list[ChunkId]:
        taken, self.queue = self.queue[:count], self.queue[count:]
        self.accounts.drop(rule, taken)
        return taken

    def checkpoint(self) -> None:
        state = {"roster": self.roster.to_state(), "accounts": self.accounts.to_state()}
        self.saved.append((self.update, json.dumps(state)))
        self.accounts.checkpointed(self.update, 10 * self.update)

    def die_and_resume(self, back: int = 0, old: bool = False) -> Recovery:
        self.accounts.close()
        del self.saved[len(self.saved) - back :]
        self.update, text = self.saved[-1]
        state = json.loads(text)
        self._begin()
        self.roster.restore(state["roster"])
        recovery = self.accounts.resume(
            None if old else state["accounts"],
            self.update,
            lambda chunk: self.roster.is_known(*chunk),
        )
        self.roster.reconcile(recovery.settled, recovery.excused)
        return recovery

    def sums(self) -> dict:
        totals = self.accounts.totals()
        for unit in ("chunks", "samples"):
            ended = sum(tally[unit] for tally in totals["dropped"].values())
            parts = totals["trained"][unit] + totals["waiting"][unit] + ended
            assert totals["accepted"][unit] == parts
        return totals


@pytest.fixture
def books(tmp_path: Path) -> Books:
    return Books(tmp_path / "ledger.jsonl")


def test_the_ledger_says_line_by_line_what_happened(books: Books) -> None:
    books.accept(A, 8)
    books.accept(B, 16)
    books.train(1)
    books.drop("stale", 1)
    books.checkpoint()
    lines = rows(books.path)[1:]
    totals = lines[-1].pop("totals")
    assert lines == [
        {"kind": "accepted", "actor": "a", "life": "x", "sequence": 1, "samples": 8},
        {"kind": "accepted", "actor": "b", "life": "y", "sequence": 1, "samples": 16},
        {"kind": "trained", "update": 1, "samples": 8, "chunks": [["a", "x", 1]]},
        {"kind": "dropped", "rule": "stale", "samples": 16, "chunks": [["b", "y", 1]]},
        {"kind": "checkpoint", "update": 1, "step": 10},
    ]
    assert totals == books.sums()
    assert totals["accepted"] == {"chunks": 2, "samples": 24}
    assert totals["trained"] == {"chunks": 1, "samples": 8}
    assert totals["dropped"]["stale"] == {"chunks": 1, "samples": 16}


def test_a_crash_drops_what_waited_and_what_was_trained_after_the_checkpoint(books: Books) -> None:
    for n in (1, 2, 3):
        books.accept(("a", "x", n))
    books.train(1)
    books.checkpoint()  # 1 is in it, 2 and 3 wait
    books.train(1)
    books.accept(("a", "x", 4))
    recovery = books.die_and_resume()
    assert (recovery.lost.chunks, recovery.newest_version, recovery.notes) == (3, 2, [])
    totals = books.sums()
    assert totals["trained"]["chunks"] == 1 and totals["dropped"]["restart"]["chunks"] == 3
    assert totals["accepted"]["chunks"] == 4 and totals["waiting"]["chunks"] == 0
    resumed, dropped = rows(books.path)[-2:]
    assert resumed == {"kind": "resumed", "update": 1}
    assert dropped["rule"] == "restart" and dropped["samples"] == 30
    assert sorted(n for _, _, n in dropped["chunks"]) == [2, 3, 4]


def test_what_a_crash_lost_may_come_again_and_is_no_gap(books: Books) -> None:
    for n in range(1, 30):
        books.accept(("a", "x", n))
    books.train(5)
    books.die_and_resume()
    assert books.accept(("a", "x", 29)), "its acknowledgement may never have arrived"
    gaps = 0
    for n in range(30, 60):
        assert books.accept(("a", "x", n))
        gaps += books.gaps
    assert gaps == 0, "the ledger explains the hole"
    for n in range(70, 100):
        books.accept(("a", "x", n))
        gaps += books.gaps
    assert gaps == 10, "it does not explain this one"
    books.sums()


def test_what_was_dropped_after_the_checkpoint_does_not_come_again(books: Books) -> None:
    books.accept(A)
    books.drop("stale", 1)
    books.die_and_resume()
    assert not books.accept(A)
    assert books.sums()["dropped"]["stale"]["chunks"] == 1


def test_two_crashes_from_one_checkpoint_count_once(books: Books) -> None:
    books.accept(A)
    books.die_and_resume()
    assert books.die_and_resume().lost.chunks == 0
    for n in range(2, 30):
        books.accept(("a", "x", n))
        assert books.gaps == 0
    assert books.sums()["accepted"]["chunks"] == 29


def test_an_older_checkpoint_makes_more_of_it_void(books: Books) -> None:
    for n in (1, 2):
        books.accept(("a", "x", n))
        books.train(1)
        books.checkpoint()
    assert books.die_and_resume(back=1).lost.chunks == 1
    totals = books.sums()
    assert totals["trained"]["chunks"] == totals["dropped"]["restart"]["chunks"] == 1


def test_a_line_cut_short_is_normal_and_does_not_spoil_the_next(books: Books) -> None:
    books.accept(A)
    books.accounts.close()
    with books.path.open("a") as file:
        file.write('{"kind":"acce')
    recovery = books.die_and_resume()
    assert recovery.notes == [] and recovery.lost.chunks == 1
    assert rows(books.path)[-1]["kind"] == "dropped"


def test_a_missing_ledger_is_said_and_what_waited_is_known_all_the_same(books: Books) -> None:
    books.accept(A)
    books.checkpoint()
    books.accounts.close()
    books.path.unlink()
    recovery = books.die_and_resume()
    assert recovery.lost.chunks == 1 and "missing" in recovery.notes[0]
    assert books.sums()["dropped"]["restart"]["chunks"] == 1


@pytest.mark.parametrize(
    "line", ["nonsense", "[1]", '{"kind":"accepted"}', "\x00" * 50, "[" * 99999]
)
def test_damage_is_said_and_stops_nothing(books: Books, line: str) -> None:
    books.accept(A)
    books.accounts.close()
    with books.path.open("a") as file:
        file.write(line + "\n")
    books.accept(B)
    recovery = books.die_and_resume()
    assert recovery.lost.chunks == 2 and "1 line is damaged" in recovery.notes[0]
    books.sums()


def test_a_ledger_that_is_a_folder_stops_nothing(tmp_path: Path) -> None:
    (tmp_path / "ledger.jsonl").mkdir()
    books = Books(tmp_path / "ledger.jsonl")
    books.accept(A)
    assert "cannot be read" in books.die_and_resume().notes[0]
    books.sums()


def test_lines_that_a_full_disk_swallowed_are_made_up_for(books: Books) -> None:
    books.accept(A)
    books.train(1)
    books.accounts.close()
    lines = books.path.read_text().splitlines(keepends=True)
    books.checkpoint()
    books.path.write_text(lines[0])  # neither the chunk nor the checkpoint got there
    recovery = books.die_and_resume()
    assert "adds up" in recovery.notes[0]
    assert books.sums()["trained"]["chunks"] == 1


def test_what_the_checkpoint_knows_as_trained_is_not_lost_though_the_ledger_lacks_the_line(
    books: Books,
) -> None:
    books.accept(A)
    books.train(1)
    books.accounts.close()
    lines = books.path.read_text().splitlines(keepends=True)
    books.checkpoint()
    books.path.write_text("".join(lines[:2]))  # of the three: checkpoint, accepted, trained
    recovery = books.die_and_resume()
    assert (recovery.lost.chunks, recovery.notes) == (0, [])
    assert books.sums()["trained"]["chunks"] == 1


def test_checkpoints_of_before_there_were_books_still_load(books: Books) -> None:
    books.accounts.close()
    books.path.unlink()
    recovery = books.die_and_resume(old=True)
    assert (recovery.notes, recovery.lost.chunks) == ([], 0)
    books.accept(A)
    assert books.sums()["accepted"]["chunks"] == 1
    assert books.die_and_resume(old=True).lost.chunks == 1
    assert books.sums()["dropped"]["restart"]["chunks"] == 1


@pytest.mark.parametrize("key, value", [("open", [["a", "x"]]), ("trained", {}), ("dropped", 3)])
def test_a_state_that_is_none_is_an_error_for_the_caller(books: Books, key, value) -> None:
    state = {**books.accounts.to_state(), key: value}
    with pytest.raises((KeyError, TypeError, ValueError)):
        Accounts().resume(state, 0, lambda chunk: False)


def test_the_file_is_bounded_and_totals_outlive_rotation(tmp_path: Path) -> None:
    books = Books(tmp_path / "ledger.jsonl", limit=4000)
    for n in range(1, 800):
        books.accept(("a", "x", n))
        if n % 10 == 0:
            books.train(9)
            books.checkpoint()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["ledger.jsonl", *(f"ledger.jsonl.{n}" for n in range(1, FILES))]
    assert max(path.stat().st_size for path in tmp_path.iterdir()) < 6000
    before = books.sums()
    recovery = books.die_and_resume()
    after = books.sums()
    assert recovery.notes == []
    assert after["trained"] == before["trained"] and after["accepted"] == before["accepted"]
    assert after["dropped"]["restart"] == before["waiting"]


def test_the_newest_totals_are_read_past_what_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "ledger.jsonl"
    assert newest_totals(path) is None
    path.write_text("")
    assert newest_totals(path) is None
    tally = {"chunks": 1, "samples": 8}
    totals = {"accepted": tally, "trained": tally, "dropped": {}, "waiting": tally}
    rows = [{"kind": "checkpoint", "update": n, "step": 10 * n, "totals": totals} for n in (1, 2)]
    rows += [{**rows[0], "totals": {**totals, "waiting": {"chunks": -1, "samples": 0}}}]
    rows += [{"kind": "accepted", "actor": "checkpoint", "samples": 4}, {"kind": "checkpoint"}]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows) + '{"kind": "checkpoint", "st')
    assert newest_totals(path) == (totals, 20)


def test_the_file_before_is_read_where_the_checkpoint_is_older(tmp_path: Path) -> None:
    books = Books(tmp_path / "ledger.jsonl", limit=1000)
    for n in range(1, 31):
        books.accept(("a", "x", n))
        books.train(1)
    books.checkpoint()
    assert (tmp_path / "ledger.jsonl.1").exists()
    recovery = books.die_and_resume(back=1)
    assert (recovery.lost.chunks, recovery.newest_version, recovery.notes) == (30, 30, [])
    assert books.sums()["dropped"]["restart"]["chunks"] == 30


class Model:
    """The contract in slow words: one record per acceptance, with what became of it."""

    def __init__(self) -> None:
        self.records: list[dict] = []

    def accept(self, chunk: ChunkId, samples: int) -> None:
        for record in self.records:
            if record["chunk"] == chunk:
                assert record["end"] == "restart", f"{chunk} was accepted twice"
        self.records.append({"chunk": chunk, "samples": samples, "end": None, "update": None})

    def end(self, chunks: list[ChunkId], end: str, update: int | None = None) -> None:
        for chunk in chunks:
            (record,) = [r for r in self.records if r["chunk"] == chunk and r["end"] is None]
            record["end"], record["update"] = end, update

    def resume(self, update: int) -> None:
        for record in self.records:
            if record["end"] is None or (record["end"] == "trained" and record["update"] > update):
                record["end"] = "restart"

    def totals(self) -> dict:
        def tally(records: list[dict]) -> dict:
            return {"chunks": len(records), "samples": sum(r["samples"] for r in records)}

        def by(end: str | None) -> dict:
            return tally([r for r in self.records if r["end"] == end])

        return {
            "accepted": tally(self.records),
            "trained": by("trained"),
            "dropped": {rule: by(rule) for rule in RULES},
            "waiting": by(None),
        }


def audit(path: Path) -> dict[str, int]:
    """An outsider's reading of the file: nothing twice, nothing without acceptance."""
    state: dict[tuple, tuple[str, int]] = {}
    sizes: dict[tuple, int] = {}
    for row in rows(path):
        chunks = [tuple(chunk) for chunk in row.get("chunks", [])]
        if row["kind"] == "accepted":
            chunk = (row["actor"], row["life"], row["sequence"])
            assert chunk not in state or state[chunk][0] == "restart"
            state[chunk], sizes[chunk] = ("open", 0), row["samples"]
            continue
        if "chunks" in row:
            assert row["samples"] == sum(sizes[chunk] for chunk in chunks)
        for chunk in chunks:
            assert state[chunk][0] == "open"
            end = "trained" if row["kind"] == "trained" else row["rule"]
            state[chunk] = (end, row.get("update", 0))
        if row["kind"] == "resumed":
            for chunk, (end, update) in state.items():
                if end == "trained" and update > row["update"]:
                    state[chunk] = ("open", 0)
    ends = [end for end, _ in state.values()]
    return {end: ends.count(end) for end in set(ends)}


actions = st.one_of(
    st.tuples(st.just("accept"), st.integers(0, 3), st.integers(1, 25)),
    st.tuples(st.just("train"), st.integers(0, 4)),
    st.tuples(st.just("drop"), st.sampled_from(["stale", "diverged", "end"]), st.integers(1, 3)),
    st.tuples(st.just("checkpoint")),
    st.tuples(st.just("die"), st.integers(0, 2), st.booleans()),
)


@settings(max_examples=150, deadline=None)
@given(story=st.lists(actions, max_size=60))
def test_any_story_adds_up(story: list[tuple]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        books, model = Books(Path(folder) / "ledger.jsonl"), Model()
        for kind, *what in story:
            if kind == "accept":
                chunk = ("ab"[what[0] % 2], "xy"[what[0] // 2], what[1])
                if books.accept(chunk, samples=what[1]):
                    model.accept(chunk, what[1])
            elif kind == "train":
                model.end(books.train(what[0]), "trained", books.update)
            elif kind == "drop":
                model.end(books.drop(*what), what[0])
            elif kind == "checkpoint":
                books.checkpoint()
            else:
                if what[1]:
                    books.accounts.close()
                    with books.path.open("a") as file:
                        file.write('{"kind":"dropped","rule":"st')
                recovery = books.die_and_resume(back=min(what[0], len(books.saved) - 1))
                assert recovery.notes == []
                model.resume(books.update)
            assert books.sums() == model.totals()
        ends = audit(books.path)
        assert ends.get("trained", 0) == model.totals()["trained"]["chunks"]
        assert ends.get("open", 0) == len(books.queue)
        books.accounts.close()
