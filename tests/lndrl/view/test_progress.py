from __future__ import annotations

import io
from typing import Any

import pytest

from lndrl.view import progress
from lndrl.view.progress import print_table, progress_bar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_without_terminal_lines_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "LINE_EVERY", 0.0)
    file = io.StringIO()
    with progress_bar(3, "evaluate", "episodes", file) as advance:
        advance()
        advance(note="one lost")
        advance()
    first, second, third, last = file.getvalue().splitlines()
    assert first == "evaluate: 3 episodes"
    assert second.startswith("evaluate: 1 of 3 episodes") and "left" in second
    assert third.endswith("one lost")
    assert last.startswith("evaluate: 3 of 3 episodes in ")


def test_lines_are_rare() -> None:
    file = io.StringIO()
    with progress_bar(100, "bench", stream=file) as advance:
        for _ in range(100):
            advance()
    assert len(file.getvalue().splitlines()) == 2


def test_on_a_terminal_there_is_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    file = Terminal()
    with progress_bar(4, "evaluate", "episodes", file) as advance:
        advance(4, note="done")
    assert "4/4" in file.getvalue() and "\x1b[" in file.getvalue()


def test_exceptions_pass_through() -> None:
    with (
        pytest.raises(RuntimeError, match="broken"),
        progress_bar(3, "evaluate", stream=io.StringIO()) as advance,
    ):
        advance()
        raise RuntimeError("broken")


def test_table_in_a_pipe_is_whole_and_plain() -> None:
    rows: list[dict[str, Any]] = [
        {"planner": "lndrl [v1]", "arrived": "0.52 ± 0.03", "episodes": 1200, "time": 22.913},
        {"planner": "straight", "arrived": None, "note": "x" * 120},
    ]
    file = io.StringIO()
    print_table(rows, "Evaluation", file=file)
    text = file.getvalue()
    assert "\x1b" not in text
    for expected in ("Evaluation", "lndrl [v1]", "0.52 ± 0.03", "1,200", "22.9", "–", "x" * 120):
        assert expected in text
    lines = [line for line in text.splitlines() if line.startswith(("lndrl", "straight"))]
    assert len(lines) == 2


def test_columns_may_be_chosen() -> None:
    file = io.StringIO()
    print_table([{"a": 1, "b": 2, "c": 3}], columns=["c", "a"], file=file)
    assert file.getvalue().split()[:2] == ["c", "a"]
