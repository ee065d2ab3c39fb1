from __future__ import annotations

import io
import json
import math
import os
import time
from collections.abc import Callable
from typing import Any

import pytest
from rich.console import Console

import lndrl.transport
from lndrl.cli.fleet.dashboard import dashboard
from lndrl.errors import UserError
from lndrl.view.dashboard import feed as feed_module
from lndrl.view.dashboard.feed import Feed, News, ask, first_news
from lndrl.view.dashboard.keys import key_presses
from lndrl.view.dashboard.live import (
    json_line,
    show_json,
    show_lines,
    show_live,
    show_once,
)

Answer = Callable[..., dict[str, Any]]


class FakeViewer:
    """Gives out answers in turn, the last one for ever; an exception is raised."""

    def __init__(self, *answers: Any) -> None:
        self.answers = list(answers)
        self.closed = 0

    def status(self, timeout: float) -> dict[str, Any]:
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, Exception):
            raise answer
        return answer

    def request(self, action: str, run_id: str, timeout: float = 5.0) -> str:
        return f"{action} of {run_id}"

    def watch(self, actor_id: str) -> Any:
        raise UserError(f"{actor_id} shows nothing")

    def close(self) -> None:
        self.closed += 1


class FakeFeed:
    """A feed whose every look brings the next news."""

    def __init__(self, *news: News) -> None:
        self.news = list(news)

    @property
    def newest(self) -> News:
        return self.news.pop(0) if len(self.news) > 1 else self.news[0]


def news_of(reply: dict[str, Any]) -> News:
    return ask(FakeViewer(reply))


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_no_learner_is_one_sentence() -> None:
    with pytest.raises(UserError, match="no learner answers at tcp/x:1"):
        first_news(FakeViewer(TimeoutError()), "tcp/x:1")


def test_feed_survives_failures_reopens_and_goes_on(
    answer: Answer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(feed_module, "ASK_EVERY", 0.005)
    monkeypatch.setattr(feed_module, "REOPEN_AFTER", 3)
    first = FakeViewer(OSError("gone"))
    second = FakeViewer(answer(time=3000.0, steps=200000))
    feed = Feed(lambda: second, first, news_of(answer()))
    try:
        wait_until(lambda: feed.newest.status.steps == 200000)
        assert first.closed == 1
    finally:
        feed.close()
    assert second.closed == 1


def test_an_old_snapshot_is_no_news(answer: Answer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feed_module, "ASK_EVERY", 0.005)
    viewer = FakeViewer(answer(), answer(), answer(), {"snapshot": "nonsense"}, answer())
    start = news_of(answer())
    feed = Feed(lambda: viewer, viewer, start)
    try:
        wait_until(lambda: len(viewer.answers) == 1)
        assert feed.newest is start
    finally:
        feed.close()


def test_lines_come_per_update_and_end_with_the_run(answer: Answer) -> None:
    feed = FakeFeed(
        news_of(answer(updates=1)),
        news_of(answer(updates=1, steps=5)),
        news_of(answer(updates=2)),
        news_of(answer(updates=2, verdict="done", state="done")),
    )
    lines: list[str] = []
    show_lines(feed, lines.append, pause=0.0)  # type: ignore[arg-type]
    assert ["done" in line for line in lines] == [False, False, True]


def test_json_is_strict_and_history_is_sent_once(answer: Answer) -> None:
    second = answer(time=3000.0, verdict="done", ppo={"kl": math.nan})
    second["history"].append({"time": 9999.0, "steps": 7})
    lines: list[str] = []
    show_json(FakeFeed(news_of(answer()), news_of(second)), lines.append, pause=0.0)  # type: ignore[arg-type]
    first, last = (json.loads(line, parse_constant=pytest.fail) for line in lines)
    assert first["snapshot"]["steps"] == 123456 and len(first["history"]) == 120
    assert [row["steps"] for row in last["history"]] == [7]
    assert last["snapshot"]["ppo"]["kl"] is None


def test_live_view_draws_and_q_quits(answer: Answer, monkeypatch: pytest.MonkeyPatch) -> None:
    termios = pytest.importorskip("termios")
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "r") as terminal:
        before = termios.tcgetattr(terminal)
        monkeypatch.setattr("sys.stdin", terminal)
        seen: list[int | None] = []

        def press(_: Any = None) -> News:
            if len(seen) == 1:
                seen.append(termios.tcgetattr(terminal)[3] & termios.ICANON)
                os.write(ours, b"q")
            else:
                seen.append(None)
            return news_of(answer())

        class PressingFeed:
            newest = property(press)

            def request(self, action: str) -> str:
                return ""

            def watch(self, actor_id: str) -> Any:
                raise UserError("nothing is shown")

        file = io.StringIO()
        console = Console(file=file, force_terminal=True, width=120, height=40)
        show_live([PressingFeed()], console)  # type: ignore[list-item]
        assert "LEARNING" in file.getvalue()
        assert seen[1] == 0, "keys must arrive without Enter"
        assert termios.tcgetattr(terminal) == before
    os.close(ours)


def test_terminal_is_restored_after_a_crash() -> None:
    termios = pytest.importorskip("termios")
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "r") as terminal:
        before = termios.tcgetattr(terminal)
        with pytest.raises(KeyboardInterrupt), key_presses(terminal):
            assert termios.tcgetattr(terminal) != before
            raise KeyboardInterrupt
        assert termios.tcgetattr(terminal) == before
    os.close(ours)


def test_without_terminal_there_are_no_keys() -> None:
    with key_presses(io.StringIO()) as keys:
        assert keys.pressed(0.0) == ""


def test_once_is_a_picture_on_a_terminal_and_a_line_elsewhere(answer: Answer) -> None:
    news = news_of(answer())
    picture, line = io.StringIO(), io.StringIO()
    show_once(news, Console(file=picture, force_terminal=True, width=100))
    show_once(news, Console(file=line))
    assert "╭" in picture.getvalue() and "\x1b[" in picture.getvalue()
    assert line.getvalue().count("\n") == 1 and line.getvalue().isascii()


def test_command(
    answer: Answer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    viewer = FakeViewer(answer())
    monkeypatch.setattr(lndrl.transport, "open_viewer", lambda *_: viewer)
    dashboard("tcp/127.0.0.1:7447", once=True, json=True)
    assert json.loads(capsys.readouterr().out) == json.loads(json_line(news_of(answer())))
    dashboard("tcp/127.0.0.1:7447", once=True, json=False)
    assert "learning" in capsys.readouterr().out
    assert viewer.closed == 2
    with pytest.raises(UserError, match="not an endpoint"):
        dashboard("localhost", once=True, json=False)
