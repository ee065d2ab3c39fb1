from __future__ import annotations

import io
import math
from collections.abc import Callable
from typing import Any

import pytest
from rich.cells import cell_len
from rich.console import Console

from lndrl.transport.status import parse_reply
from lndrl.view.dashboard.actors import worst_first
from lndrl.view.dashboard.screen import plain_line, render

Answer = Callable[..., dict[str, Any]]


def drawn(reply: dict[str, Any], width: int, height: int | None, age: float = 0.0) -> list[str]:
    status, history = parse_reply(reply)
    file = io.StringIO()
    # Far wider than asked, so that a line too long shows instead of being wrapped or cut.
    console = Console(file=file, width=400, height=200, no_color=True)
    console.print(render(status, history, width, height, age, "q quits"), end="")
    return file.getvalue().rstrip("\n").split("\n")


@pytest.mark.parametrize("size", [(200, 60), (120, 40), (80, 24), (60, 24), (60, 50), (100, 20)])
def test_says_verdict_and_key_numbers(answer: Answer, size: tuple[int, int]) -> None:
    words = "\n".join(drawn(answer(), *size))
    for expected in ("LEARNING", "crowd-7", "123,456", "10.3 %", "82.4", "3 h 41 min", "55.2 %"):
        assert expected in words
    for row in ("arrived", "collided", "lost", "stuck", "KL", "node-3", "wait 30 %", "event 19"):
        assert row in words


@pytest.mark.parametrize("width", [60, 61, 70, 75, 76, 77, 78, 80, 99, 100, 120, 171])
@pytest.mark.parametrize("height", [8, 12, 18, 24, 31, 32, 40, 70, None])
def test_never_exceeds_its_size(answer: Answer, width: int, height: int | None) -> None:
    for reply in (answer(), answer(fleet=0, log=0, rows=0), answer(fleet=60)):
        lines = drawn(reply, width, height, age=33.0)
        assert max(cell_len(line) for line in lines) <= width
        assert height is None or len(lines) <= height


def test_actor_table_is_cropped_and_counts_the_rest(answer: Answer) -> None:
    words = "\n".join(drawn(answer(fleet=60), 80, 24))
    shown = sum(f"node-{i} " in words for i in range(60))
    assert 0 < shown < 60
    assert f"+{60 - shown} more" in words


@pytest.mark.parametrize("width", [60, 80, 100, 120])
def test_columns_that_do_not_fit_go_whole(answer: Answer, width: int) -> None:
    lines = drawn(answer(), width, 40)
    heading = next(line for line in lines if " last ack" in line)
    assert ("restarts" in heading) == (width >= 60) and ("host" in heading) == (width >= 100)
    assert any("node-3" in line and "2 min 14 s" in line for line in lines)


@pytest.mark.parametrize("size", [(120, 40), (80, 24), (60, 24)])
def test_warnings_do_not_push_outcomes_out(answer: Answer, size: tuple[int, int]) -> None:
    sick = {"kl": 0.2, "value_loss": math.nan, "entropy": 0.01, "explained_variance": -3.0}
    words = "\n".join(drawn(answer(ppo=sick, verdict="learner-bound"), *size))
    assert "55.2 %" in words and "KL" in words and "!!" in words and "node-3" in words


def test_validation_is_drawn_with_its_interval(answer: Answer) -> None:
    words = "\n".join(drawn(answer(), 120, 46))
    for part in ("validation", "88.0 %", "95 %: 80 to 93", "best 91.0 % at 90,000"):
        assert part in words
    assert "step 110,000, 2 min ago · 100 episodes a round" in words
    low = "\n".join(drawn(answer(), 80, 24))
    assert "validation  88.0 % arrived (80 to 93) at 110,000  best 91.0 % at 90,000" in low
    assert "validation" not in "\n".join(drawn(answer(validation=None), 120, 46))
    none = {"episodes": 100, "points": [], "heard": None}
    assert "no evaluator has come yet" in "\n".join(drawn(answer(validation=none), 120, 46))


@pytest.mark.parametrize(
    "odd", [{"points": [{"sampled": {"arrived": 5}}]}, {"points": [{}], "best": {}}]
)
def test_odd_counts_do_not_stop_the_drawing(answer: Answer, odd: dict[str, Any]) -> None:
    for size in ((120, 46), (80, 24)):
        assert "validation" in "\n".join(drawn(answer(validation=odd), *size))
    assert plain_line(parse_reply(answer(validation=odd))[0]).isascii()


def test_worst_actor_stands_first(answer: Answer) -> None:
    status, _ = parse_reply(answer())
    states = [actor.state for actor in worst_first(status.actors)]
    assert states == ["gone", "slow", *["active"] * 7]


def test_actors_stand_in_the_order_of_their_numbers(answer: Answer) -> None:
    status, _ = parse_reply(answer(fleet=12))
    alike = [actor.id for actor in worst_first(status.actors) if actor.lag < 2][1:]
    assert alike == ["node-0", "node-1", "node-4", "node-6", "node-7", "node-9", "node-10"]


@pytest.mark.parametrize(
    ("change", "age", "expected"),
    [
        ({"verdict": "waiting for actors", "actors": []}, 0.0, ["WAITING FOR ACTORS", "start"]),
        ({"verdict": "learner-bound"}, 0.0, ["LEARNER-BOUND", "busy 70 %", "2 chunks wait"]),
        ({"verdict": "learner-bound"}, 0.0, ["actors idle 18 %", "no more actors"]),
        ({"verdict": "actor-bound"}, 0.0, ["ACTOR-BOUND", "waits 30 %"]),
        ({"verdict": "balanced"}, 0.0, ["BALANCED", "learner busy 70 %, actors 82 %"]),
        ({"verdict": "done", "state": "done"}, 999.0, ["DONE", "123,456 steps trained"]),
        ({}, 14.0, ["STALE", "last heard 14 s ago, then learning"]),
        ({"verdict": "", "state": "waiting"}, 0.0, ["WAITING FOR ACTORS"]),
        ({"verdict": "dreaming: of sheep"}, 0.0, ["DREAMING", "of sheep"]),
    ],
)
def test_verdicts(answer: Answer, change: dict[str, Any], age: float, expected: list[str]) -> None:
    words = "\n".join(drawn(answer(**change), 120, 40, age))
    for part in expected:
        assert part in words


def test_both_sides_of_the_balance_are_drawn(answer: Answer) -> None:
    wide = drawn(answer(), 160, 40)
    learner = next(line for line in wide if "learner █" in line)
    actors = next(line for line in wide if "actors  █" in line)
    for part in ("update 59 %", "ingest 5 %", "wait 30 %", "other 3 %"):
        assert part in learner
    for part in ("simulate 50 %", "infer 20 %", "upload 5 %", "wait 18 %", "other 3 %"):
        assert part in actors
    assert any("overhead 16 % (actors 15 %)" in line for line in wide)
    narrow = drawn(answer(), 60, 40)
    assert any("actors  █" in line and "simulate 50 %" in line for line in narrow)
    older = drawn(answer(actor_split={}, overhead_actor=None), 160, 40)
    assert not any("actors  █" in line or "overhead" in line for line in older)


def test_unhealthy_numbers_are_marked_and_explained(answer: Answer) -> None:
    sick = {"kl": 0.2, "value_loss": math.nan, "entropy": 2.0}
    words = "\n".join(drawn(answer(ppo=sick), 120, 40))
    assert "0.200!!" in words
    assert "NaN!!" in words
    assert "the policy jumps" in words
    assert "2.00 " in words and "2.00!" not in words
    assert "healthy" in "\n".join(drawn(answer(), 120, 40))


def test_text_of_others_cannot_leave_its_line(answer: Answer) -> None:
    events = [{"time": 1.0, "kind": "join", "text": "a\x1b[2Jb\nc [red]d[/red] 漢字" * 9}]
    attacked = drawn(answer(events=events, run_name="evil\nname"), 80, 24)
    assert len(attacked) <= 24
    assert max(cell_len(line) for line in attacked) <= 80
    assert "\x1b[2J" not in "".join(attacked)
    assert "[red]" in "".join(attacked)


def test_colour_follows_the_verdict(answer: Answer) -> None:
    status, history = parse_reply(answer())
    # Styles, not escape codes: rich keeps the codes of the first colour system that a style was
    # written for, and whatever ran before in this process may have had fewer colours.
    console = Console(file=io.StringIO(), force_terminal=True, width=120)
    for age, words, colour in ((0.0, "● LEARNING", "#009e73"), (60.0, "✖ STALE", "#d55e00")):
        drawn = console.render(render(status, history, 120, 40, age))
        styles = [style for text, style, _ in drawn if text.startswith(words)]
        assert styles and all(style is not None for style in styles)
        for style in filter(None, styles):
            assert style.bold and style.color is not None and style.color.name == colour


def test_plain_line_is_one_ascii_line(answer: Answer) -> None:
    status, _ = parse_reply(answer())
    line = plain_line(status)
    assert line.isascii() and "\n" not in line
    for expected in ("learning", "123,456/1,200,000 (10.3%)", "81.3 steps/s", "actors 8/9"):
        assert expected in line
    assert "arrived 55.2%" in line and "stuck 21.0%" in line
    assert "stale, last heard 40 s ago" in plain_line(status, 40.0)
    least, _ = parse_reply({"snapshot": {"time": 0.0, "steps": 0, "total_steps": 0}})
    assert plain_line(least).isascii()
