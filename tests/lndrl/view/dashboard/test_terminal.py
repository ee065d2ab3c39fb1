"""The dashboard as a user sees it: in a real terminal, on a real connection, with many actors."""

from __future__ import annotations

import re
import signal
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lndrl.cli.main import run
from lndrl.config import TransportConfig
from lndrl.navigation import WorldSnapshot
from lndrl.navigation.live import Framer
from lndrl.transport import Hello, LearnerEndpoint, free_endpoint, open_actor, open_learner
from lndrl.transport.status import parse_reply
from lndrl.view.dashboard.actors import matching, ordered
from tests.lndrl.transport.security.sites import Handlers
from tests.lndrl.view.dashboard.terminal import Program
from tests.lndrl.view.dashboard.worlds.test_worlds import moment

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


class Stage:
    """The first actor of the table, as it shows what it is told to."""

    def __init__(self, talker: Talker) -> None:
        status, _ = parse_reply(talker.answer(fleet=300))
        here = [a.id for a in ordered(matching(status.actors, ""), "name") if a.state != "gone"]
        self.actor_id = here[0]
        self.showing: list[WorldSnapshot] = []
        self.endpoint = open_actor(talker.endpoint)
        self.endpoint.hello(Hello(self.actor_id, "first", "here", 1, 8, "0.1"), 60.0)
        self._framer = Framer("r1", self.actor_id)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._show)
        self._thread.start()

    def _show(self) -> None:
        turn = 0
        while not self._stop.wait(0.1):
            if self.showing and self.endpoint.watched():
                turn += 1
                snapshot = self.showing[turn % len(self.showing)]
                self.endpoint.show(self._framer.frame(snapshot, 12))

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.endpoint.close()


@pytest.fixture
def stage(talker: Talker) -> Iterator[Stage]:
    talker.say()
    found = Stage(talker)
    yield found
    found.close()


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
    talker: Talker,
    stage: Stage,
    world: Callable[..., WorldSnapshot],
    start: Callable[..., Program],
    size: tuple[int, int],
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
    _watch_worlds(program, stage, world)
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


def _watch_worlds(program: Program, stage: Stage, world: Callable[..., WorldSnapshot]) -> None:
    """The live world of the first actor that is there, of the next one, and back."""
    assert not stage.endpoint.watched(), "nobody has asked"
    program.press("l", f"live world of {stage.actor_id}", "waiting for its first picture")
    stage.showing = [moment(world, steps=12), moment(world, steps=13)]
    text = program.press("", "m to go", "0.07 m", "arrows: the next actor's, l: back")
    assert "▀" in text and "approach" in text and "turning" in text
    stage.showing = [moment(world, "lost", steps=30)]
    program.press("", "LOST after 12.0 s", "1 lost")
    program.type(RIGHT)
    program.until(lambda text: f"live world of {stage.actor_id}" not in text)
    program.press(LEFT, f"live world of {stage.actor_id}", "LOST after 12.0 s")
    program.press("?", "any key closes this", "the live world of")
    program.type("x")
    program.type("l")
    program.until(lambda text: "live world" not in text)
    deadline = time.monotonic() + 60.0
    while stage.endpoint.watched() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not stage.endpoint.watched(), "who looks away is sent nothing"


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


def test_pictures_in_files(
    talker: Talker,
    stage: Stage,
    world: Callable[..., WorldSnapshot],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("LINES", "34")
    talker.say()
    present, live = tmp_path / "now.svg", tmp_path / "world.svg"
    assert run(["dashboard", talker.endpoint, "--svg", str(present)]) == 0
    assert "100 x 34 characters" in capsys.readouterr().out
    stage.showing = [moment(world, "lost", steps=30)]
    talker.say(actors=[{"id": stage.actor_id, "state": "active", "worlds": 8}])
    assert run(["dashboard", talker.endpoint, "--svg", str(live), "--world"]) == 0
    for file, words in ((present, "outcomes"), (live, "LOST")):
        text = file.read_text()
        tree = ElementTree.fromstring(text)
        assert words in "".join(tree.itertext()).replace("\xa0", " ")
        assert "@font-face" not in text and "url(http" not in text
        assert len(text) < 300_000
    for wrong, sentence in (
        (["--svg", str(tmp_path / "now.png")], "must end in .svg"),
        (["--world"], "--world goes with --svg"),
    ):
        assert run(["dashboard", talker.endpoint, *wrong]) == 2
        assert sentence in capsys.readouterr().err


def test_several_runs_stand_side_by_side(
    talker: Talker, answer_maker: Answer, start: Callable[..., Program]
) -> None:
    other = Talker(answer_maker)
    try:
        talker.say()
        other.say(run_name="other-run", fleet=9)
        command = ["-m", "lndrl", "dashboard", talker.endpoint, other.endpoint, "--theme", "dark"]
        program = Program(command, (140, 40))
        try:
            before = len(talker.handlers.requests)
            text = program.until(lambda text: "? help" in text)
            first = text.splitlines()[0]
            assert "crowd-7" in first and "other-run" in first
            assert "run 1 of 2: crowd-7" in text
            program.press("2", "run 2 of 2: other-run")
            program.press("c", "a checkpoint it is")
            assert len(other.handlers.requests) == 1
            assert len(talker.handlers.requests) == before
            program.type("q")
            assert program.end() == 0 and program.restored()
        finally:
            program.close()
    finally:
        other.learner.close()
