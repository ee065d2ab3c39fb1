"""Rows of a file that grows, is cut by a resume, and may end in half a line."""

from __future__ import annotations

import json
from pathlib import Path

from lndrl.view.tracking.feed import Feed


def line(update: int, unix: float) -> str:
    return json.dumps({"update": update, "time": {"unix": unix}}) + "\n"


def updates(feed: Feed) -> list[int]:
    return [row["update"] for row in feed.read()]


def test_each_row_comes_once_and_half_a_line_waits_for_its_end(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    feed = Feed(path)
    assert updates(feed) == []
    path.write_text(line(1, 10.0) + line(2, 11.0)[:9])
    assert updates(feed) == [1]
    path.write_text(line(1, 10.0) + line(2, 11.0) + "{broken\n" + line(3, 12.0))
    assert updates(feed) == [2, 3]
    assert updates(feed) == []


def test_what_is_known_already_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    validated = {"update": 2, "validation": {"unix": 10.5}}
    path.write_text(line(1, 10.0) + json.dumps(validated) + "\n" + line(2, 11.0))
    assert updates(Feed(path, 10.2)) == [2, 2]
    assert updates(Feed(path, 10.5)) == [2]


def test_what_a_resumed_run_does_again_comes_again(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_text("".join(line(i, 10.0 + i) for i in range(1, 6)))
    feed = Feed(path)
    assert updates(feed) == [1, 2, 3, 4, 5]
    # Cut after the third, and grown beyond its old length before anybody has looked.
    kept = [line(i, 10.0 + i) for i in range(1, 4)]
    path.write_text("".join(kept + [line(i, 100.0 + i) for i in range(4, 9)]))
    assert updates(feed) == [4, 5, 6, 7, 8]
    path.write_text("".join(kept))
    assert updates(feed) == []
    path.write_text("".join([*kept, line(4, 200.0)]))
    assert updates(feed) == [4]
