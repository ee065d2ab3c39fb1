from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

from learner.run.history import History


def test_the_whole_run_in_few_rows_of_equal_distance() -> None:
    history = History(most=10)
    for i in range(1000):
        history.add({"n": i})
        rows = [row["n"] for row in history]
        assert len(rows) <= 11 and rows[0] == 0 and rows[-1] == i
        between = {b - a for a, b in pairwise(rows[:-1])}
        assert len(between) <= 1


def test_rows_from_before_a_resume(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    lines = [json.dumps({"update": i, "ppo": {}, "n": i}) for i in range(250)]
    lines.insert(40, json.dumps({"validation": {"n": -1, "ppo": 1}}))
    lines[100] = '{"ppo": half'
    path.write_text("\n".join(lines) + "\n")
    history = History(most=100)
    history.take_up(path, lambda row: {"n": row["n"]})
    rows = [row["n"] for row in history]
    assert rows[0] == 0 and len(rows) <= 100 and rows == sorted(rows) and rows[-1] >= 244
    history.add({"n": 250})
    assert [row["n"] for row in history][-1] == 250
    nothing = History()
    nothing.take_up(tmp_path / "none", lambda row: row)
    assert list(nothing) == []
