"""Hand-made ledgers: what is lost, duplicated, rolled back, torn; and that honest ones balance."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from lndrl.chaos.ledger import ActorBook, Balance, LearnerBook, balance, files_of, lines_of, parse


def accepted(*numbers: int, samples: int = 8) -> list[dict[str, Any]]:
    return [
        {"kind": "accepted", "actor": "a", "life": "x", "sequence": n, "samples": samples}
        for n in numbers
    ]


def trained(update: int, *numbers: int) -> dict[str, Any]:
    chunks = [["a", "x", n] for n in numbers]
    return {"kind": "trained", "update": update, "samples": 8 * len(chunks), "chunks": chunks}


def dropped(rule: str, *numbers: int) -> dict[str, Any]:
    chunks = [["a", "x", n] for n in numbers]
    return {"kind": "dropped", "rule": rule, "samples": 8 * len(chunks), "chunks": chunks}


def resumed(update: int) -> dict[str, Any]:
    return {"kind": "resumed", "update": update}


def books(learner: list[Any], *numbers: int, answers: dict[int, str] | None = None) -> Balance:
    """A balance of the learner's lines (objects or text) and of chunks that actors produced."""
    text = [line if isinstance(line, str) else json.dumps(line) for line in learner]
    produced = [{**line, "kind": "produced"} for line in accepted(*numbers)]
    settled = [
        {"kind": "settled", "actor": "a", "life": "x", "sequence": n, "status": status}
        for n, status in (answers or {}).items()
    ]
    lines = [json.dumps(line) for line in (*produced, *settled)]
    return balance(LearnerBook().read(text), ActorBook().read(lines))


def test_trained_and_dropped_chunks_balance() -> None:
    lines = [*accepted(1, 2, 3), trained(1, 1, 2), dropped("stale", 3)]
    found = books(lines, 1, 2, 3, 4, 5, answers={1: "accepted", 2: "duplicate", 5: "refused"})
    assert (found.produced, found.acknowledged, found.trained) == (40, 24, 16)
    assert found.dropped_by_rule == {"stale": 8}
    assert (found.lost, found.duplicated, found.contradictions) == (0, 0, 0)
    assert (found.refused, found.unanswered) == (8, 16)


def test_a_chunk_without_a_fate_is_lost() -> None:
    found = books([*accepted(1, 2), trained(1, 1)], 1, 2)
    assert (found.lost, found.duplicated) == (8, 0)
    assert "('a', 'x', 2) was accepted and forgotten" in found.examples


def test_an_acknowledgement_that_the_learner_never_wrote_down_is_lost() -> None:
    found = books([*accepted(1), trained(1, 1)], 1, 2, answers={2: "accepted"})
    assert found.lost == 8


def test_a_chunk_trained_on_twice_is_duplicated() -> None:
    assert books([*accepted(1), trained(1, 1), trained(2, 1)], 1).duplicated == 8
    assert books([*accepted(1), trained(1, 1, 1)], 1).duplicated == 8
    assert books([*accepted(1), dropped("stale", 1), trained(2, 1)], 1).duplicated == 8
    twice = [*accepted(1), trained(1, 1), *accepted(1), trained(2, 1)]
    assert books(twice, 1).duplicated == 8


def test_an_update_beyond_the_checkpoint_is_void_after_a_restart() -> None:
    lines = [*accepted(1, 2, 3), trained(1, 1), {"kind": "checkpoint", "update": 1, "step": 8}]
    lines += [trained(2, 2), resumed(1), dropped("restart", 2, 3)]
    found = books(lines, 1, 2, 3)
    assert (found.trained, found.dropped_by_rule, found.lost) == (8, {"restart": 16}, 0)
    assert (found.rolled_back, found.duplicated, found.contradictions) == (8, 0, 0)
    # The sender of 3 never heard of its acceptance and sends it again.
    again = books([*lines, *accepted(3), trained(2, 3)], 1, 2, 3)
    assert (again.trained, again.acknowledged, again.accepted_again) == (16, 32, 8)
    assert (again.dropped_by_rule, again.lost, again.duplicated) == ({"restart": 16}, 0, 0)


def test_a_restart_that_forgets_to_drop_loses() -> None:
    lines = [*accepted(1, 2), trained(1, 1), trained(2, 2), resumed(1)]
    assert books(lines, 1, 2).lost == 8


def test_torn_lines_are_counted_and_what_follows_on_them_counts() -> None:
    half = json.dumps(accepted(2)[0])[:25]
    lines = [*accepted(1), half, half + json.dumps(resumed(0)), dropped("restart", 1)]
    found = books(lines, 1, 2)
    assert (found.torn_lines, found.resumes, found.lost, found.contradictions) == (1, 1, 0, 0)
    assert parse(half) is None
    assert parse("[1]") is None
    assert parse("") is None


def test_what_does_not_fit_together_is_named() -> None:
    for lines in (
        [trained(1, 9)],
        [dropped("stale", 9)],
        [*accepted(1, samples=9), dropped("stale", 1)],
        [*accepted(1), dropped("end", 1), dropped("end", 1)],
        [*accepted(1), {**trained(1, 1), "samples": 7}],
        [*accepted(1, 1), trained(1, 1)],
        [{"kind": "eaten"}],
        [{"kind": "trained", "update": "soon", "samples": 0, "chunks": [[]]}],
    ):
        found = books(lines, 1)
        assert found.contradictions > 0, lines
        assert found.examples


@given(st.integers(0, 10**6))
def test_honest_ledgers_balance_whatever_happened(seed: int) -> None:
    """A learner that keeps the promise, killed at will, its last line torn or not."""
    draw = random.Random(seed)
    lines: list[Any] = []
    queue: list[int] = []
    done: list[tuple[int, list[int]]] = []
    update = kept = sequence = 0
    for _ in range(draw.randrange(60)):
        event = draw.choice(["accept", "accept", "accept", "train", "stale", "save", "kill"])
        if event == "accept":
            sequence += 1
            lines += accepted(sequence)
            queue.append(sequence)
        elif event == "train" and queue:
            update += 1
            batch, queue = queue[:2], queue[2:]
            lines.append(trained(update, *batch))
            done.append((update, batch))
        elif event == "stale" and queue:
            lines.append(dropped("stale", queue.pop(0)))
        elif event == "save":
            kept = update
        elif event == "kill":
            void = [n for number, batch in done if number > kept for n in batch]
            done = [(number, batch) for number, batch in done if number <= kept]
            torn = json.dumps(trained(99, 1))[:30] if draw.random() < 0.5 else ""
            lines += [torn + json.dumps(resumed(kept)), dropped("restart", *void, *queue)]
            update = kept
            back = [n for n in queue if draw.random() < 0.5]
            lines += accepted(*back)
            queue = back
    lines.append(dropped("end", *queue))
    found = books(lines, *range(1, sequence + 1))
    assert (found.lost, found.duplicated, found.contradictions) == (0, 0, 0)
    assert found.acknowledged == found.trained + found.dropped
    assert found.trained == 8 * sum(len(batch) for _, batch in done)


def test_a_ledger_is_read_with_all_the_files_it_went_on_from(tmp_path: Path) -> None:
    ledger = tmp_path / "ledger.jsonl"
    for number, name in enumerate((*(f"ledger.jsonl.{n}" for n in range(11, 0, -1)), ledger.name)):
        (tmp_path / name).write_text(f"{number}\n")
    (tmp_path / "ledger.jsonl.gz").write_text("whatever an operator put there\n")
    assert [int(line) for line in lines_of(*files_of(ledger))] == list(range(12))
    assert files_of(tmp_path / "none.jsonl") == [tmp_path / "none.jsonl"]
