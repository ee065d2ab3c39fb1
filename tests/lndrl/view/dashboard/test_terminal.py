"""The dashboard as a user sees it: in a real terminal, on a real connection, with many actors."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from lndrl.config import TransportConfig
from lndrl.transport import LearnerEndpoint, free_endpoint, open_learner
from tests.lndrl.transport.security.sites import Handlers
from tests.lndrl.view.dashboard.terminal import Program

Answer = Callable[..., dict[str, Any]]
UP, DOWN, LEFT, RIGHT = "\x1b[A", "\x1b[B", "\x1b[D", "\x1b[C"


class Talker:
    """A learner that says what it is told to."""

    def __init__(self, answer: Answer) -> None:
        self.answer = answer
        self.endpoint = free_endpoint()
        config = TransportConfig(endpoint=self.endpoint)
        self.learner: LearnerEndpoint = open_learner(config, "r1")
        self.handlers = Handlers()
        self.learner.start(self.handlers, self.handlers, self.handlers)
        self.say()

    def say(self, **changes: Any) -> None:
        reply = self.answer(**{"fleet": 300, "time": time.time(), **changes})
        self.learner.publish_status(reply["snapshot"], reply["history"])


@pytest.fixture(scope="module")
def talker(answer_maker: Answer) -> Iterator[Talker]:
    found = Talker(answer_maker)
    yield found
    found.learner.close()


@pytest.fixture
def start(talker: Talker) -> Iterator[Callable[..., Program]]:
    open_programs: list[Program] = []

    def begin(size: tuple[int, int], *options: str, **environment: str) -> Program:
        command = ["-m", "lndrl", "dashboard", "--connect", talker.endpoint, *options]
        open_programs.append(Program(command, size, **environment))
        return open_programs[-1]

    yield begin
    for program in open_programs:
        program.close()


@pytest.mark.parametrize("size", [(80, 24), (120, 40), (200, 60)])
def test_keys_work_and_nothing_overflows(
    talker: Talker, start: Callable[..., Program], size: tuple[int, int]
) -> None:
    talker.say()
    program = start(size, "--theme", "dark")
    first = program.until(lambda text: "? help" in text)
    assert "LEARNING" in first and "node-3 " in first and "more (" in first
    assert first.splitlines()[-1].endswith("? help  q leaves")
    program.press("?", "any key closes this", "the panel on the whole screen")
    program.type("x")
    program.until(lambda text: "any key" not in text)
    program.press("\t", "▸ outcomes")
    program.press("\r", "Enter back", "step 0", "step 11,900")
    program.press("\r" + RIGHT, "▸ ppo")
    program.press("\r", "Enter back", "KL")
    program.press("\r" + "\x1b[Z" + LEFT, "▸ events")
    program.press(LEFT, "▸ machines")
    program.press(LEFT + "\r", "▸ actors", "Enter back", "node-3 ")
    worst = program.screen.text
    program.press(DOWN * 3, "3 above")
    program.press("\x1b[F", "above", "node-298 ")
    assert "more (" not in program.screen.text
    program.press("\x1b[H", "more (")
    program.until(lambda text: _table(text) == _table(worst))
    program.press("s", "by actor")
    named = _table(program.until(lambda text: "node-0 " in text))
    assert named[:4] == ["node-0", "node-1", "node-2", "node-3"]
    program.press("/29\r", "/29", "without these words", "node-129 ")
    found = _table(program.screen.text)
    assert found[:3] == ["node-29", "node-129", "node-229"]
    # In two writes, as people type: an ESC that something follows at once is another key.
    program.press("\x1b", "by actor", "more (")
    program.press(" ", "HELD")
    talker.say(steps=777_777)
    time.sleep(1.5)
    program.read()
    assert "777,777" not in program.screen.text
    program.press(" ", "777,777")
    talker.handlers.requests.clear()
    program.press("c", "a checkpoint it is")
    program.press("S", "S again within 10 s stops the run")
    program.press("S", "a stop it is")
    assert [(r.action, r.run_id) for r in talker.handlers.requests] == [
        ("checkpoint", "r1"),
        ("stop", "r1"),
    ]
    program.type("q")
    assert program.end() == 0
    assert program.restored()


def _table(text: str) -> list[str]:
    return re.findall(r"^[│ ]*(node-\d+) ", text, re.MULTILINE)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_terminal_is_restored_after_a_signal(
    start: Callable[..., Program], number: signal.Signals
) -> None:
    program = start((80, 24), NO_COLOR="1")
    program.until(lambda text: "? help" in text)
    assert not program.restored()
    assert program.end(number) == 128 + number
    assert program.restored()
    assert "Traceback" not in program.raw
    colours = {code for style in program.screen.styles for code in style.split(";")}
    assert colours <= {"", "0", "1", "2"}, "NO_COLOR leaves bold and pale"


def test_an_asked_terminal_says_that_it_is_light(start: Callable[..., Program]) -> None:
    program = start((80, 24), COLORTERM="truecolor")
    program.until(lambda _: "\x1b]11;?" in program.raw)
    program.type("\x1b]11;rgb:ffff/fcfc/f0f0\x1b\\\x1b[?1;2c")
    text = program.until(lambda text: "? help" in text)
    assert "▸" not in text, "what a terminal answers is no key"
    assert any("0;112;79" in style for style in program.screen.styles)
    assert not any("0;158;115" in style for style in program.screen.styles)
