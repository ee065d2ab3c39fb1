"""A real training in terminals of three sizes: viewers look at it until an operator ends it."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml
from rich.cells import cell_len

from lndrl.chaos.stage import Child, descendants, is_worker, lives, wait_for
from lndrl.transport import free_endpoint
from lndrl.view.dashboard.screen import ROOMY
from tests.lndrl.view.dashboard.terminal import Program
from tests.small import small_run

SIZES = [(80, 24), (120, 40), (200, 60)]
PASSWORDS = {"actor": "walks", "dashboard": "sees", "operator": "decides"}
PANELS = ("outcomes", "ppo", "actors", "machines", "events")
CORNER = "? help  q leaves"
PATIENCE = 600.0  # s; compiling on a busy machine takes long
TRIES = 3
SETTLED = 10.0  # s within which the rest of a picture has come, however busy the machine is

Attach = Callable[[str, tuple[int, int]], Program]


class Training:
    """``lndrl train`` in ``folder`` with one actor; it lets in the users of PASSWORDS."""

    def __init__(self, folder: Path) -> None:
        self.run = folder / "runs" / "a"
        self.endpoint = free_endpoint()
        (folder / "small.yaml").write_text(yaml.safe_dump(small_run(10**9, time_limit=8.0)))
        users = folder / "users"
        users.touch(0o600)
        users.write_text("".join(f"{name}:{word}\n" for name, word in PASSWORDS.items()))
        command = ["lndrl", "train", "small.yaml", "--run", "a", "--listen", self.endpoint]
        command += ["--users", "users", "--no-dashboard"]
        self.child = Child("training", command, folder)
        self.child.start()

    def updates(self) -> int:
        path = self.run / "metrics.jsonl"
        return path.read_text().count("\n") if path.exists() else 0

    def wait(self, what: str, condition: Callable[[], bool]) -> None:
        ended = self.child.process
        assert ended is not None
        try:
            wait_for(what, condition, PATIENCE, lambda: ended.poll() not in (None, 0))
        except (TimeoutError, InterruptedError) as error:
            raise AssertionError(f"no {what}; it said:\n{self.child.tail()}") from error


@pytest.fixture(scope="module")
def training(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Training]:
    found = Training(tmp_path_factory.mktemp("training"))
    try:
        found.wait("update", lambda: found.updates() >= 2)
        yield found
    finally:
        family = descendants(found.child.pid)
        found.child.kill()
        found.wait("end of the actors", lambda: not any(lives(pid) for pid in family))


@pytest.fixture
def attach(training: Training) -> Iterator[Attach]:
    """Opens a dashboard as a user, in a terminal of some size."""
    programs: list[Program] = []

    def begin(user: str, size: tuple[int, int]) -> Program:
        command = ["-m", "lndrl", "dashboard", "--connect", training.endpoint, "--user", user]
        command += ["--theme", "dark"]
        programs.append(Program(command, size, LNDRL_PASSWORD=PASSWORDS[user]))
        return programs[-1]

    yield begin
    for program in programs:
        program.close()


def cut_rows(program: Program) -> list[str]:
    """Rows of which something went over an edge.

    rich cuts what is too wide for the terminal, a line's border first, and what is too high, the
    corner with the help first: nothing ever goes over the edge, but something is missing. Where
    there is no room for borders, the line of progress, which is as wide as the screen, tells.
    """
    width = program.screen.width
    boxed = width >= ROOMY[0] and program.screen.height > ROOMY[1]
    *rows, last = program.screen.text.splitlines()
    borders = [row for row in rows if row[:1] in tuple("╭│╰")]
    cut = [row for row in borders if cell_len(row) != width or row[-1] not in "╮│╯"]
    if boxed and len(borders) < len(rows) - 1:  # the machines have a line of their own
        cut += [row for row in rows if row not in borders]
    if not last.endswith(CORNER) or cell_len(last) != width:
        cut.append(last)
    return cut


def assert_whole(program: Program) -> None:
    deadline = time.monotonic() + SETTLED
    while (cut := cut_rows(program)) and time.monotonic() < deadline:
        program.read()
    assert cut == [], program.screen.text


def steps(text: str) -> int:
    found = re.search(r"([\d,]+) of 1,000,000,000 steps", text)
    return int(found[1].replace(",", "")) if found else -1


def ask_for_a_stop(program: Program, answer: str) -> None:
    """S twice, and again where the second did not come within 10 s because the machine is busy."""
    waiting = ("S again within 10 s", "asking for a stop")
    for _ in range(TRIES):
        program.press("S", waiting[0])
        program.type("S")
        program.until(lambda text: answer in text or not any(words in text for words in waiting))
        if answer in program.screen.text:
            return
    raise AssertionError(f"not {answer!r}:\n{program.screen.text}")


@pytest.mark.parametrize("size", SIZES)
def test_a_viewer_sees_all_of_it_and_may_not_stop_it(
    training: Training, attach: Attach, size: tuple[int, int]
) -> None:
    viewer = attach("dashboard", size)
    text = viewer.until(lambda text: CORNER in text and steps(text) > 0)
    assert "lndrl · a" in text and "outcomes" in text and "events" in text
    assert_whole(viewer)
    viewer.press("?", "any key closes this", "hold the picture")
    assert_whole(viewer)
    viewer.type("x")
    viewer.until(lambda text: "any key" not in text)
    for panel in PANELS:
        viewer.press("\t", f"▸ {panel}: Enter whole screen")
        viewer.press("\r", f"▸ {panel}: Enter back")
        assert_whole(viewer)
        viewer.press("\r", f"▸ {panel}: Enter whole screen")
        assert_whole(viewer)
    held = steps(viewer.press(" ", "HELD, "))
    behind = viewer.until(lambda text: re.search(r"HELD, ([1-9]\d|[2-9]) s behind", text))
    assert steps(behind) == held
    viewer.type(" ")
    viewer.until(lambda text: steps(text) > held)
    ask_for_a_stop(viewer, "refused: the role dashboard may only look")
    assert_whole(viewer)
    updates = training.updates()
    training.wait("update after a refusal", lambda: training.updates() >= updates + 2)
    assert " operator " not in (training.run / "events.log").read_text()
    viewer.type("q")
    assert viewer.end() == 0 and viewer.restored()


def test_an_operator_ends_it_with_a_checkpoint_and_no_process(
    training: Training, attach: Attach
) -> None:
    viewer, operator = attach("dashboard", SIZES[0]), attach("operator", SIZES[1])
    for each in (viewer, operator):
        each.until(lambda text: CORNER in text and steps(text) > 0)
    family = descendants(training.child.pid)
    assert [pid for pid in family if is_worker(pid)]
    ask_for_a_stop(operator, "the run stops after the update at work")
    training.wait("end", lambda: not training.child.alive())
    assert training.child.process is not None and training.child.process.returncode == 0
    training.wait("end of the actors", lambda: not any(lives(pid) for pid in family))
    said = training.child.log()
    assert "Traceback" not in said and "--resume" in said.splitlines()[-1]
    log = (training.run / "events.log").read_text()
    assert "operator operator at " in log and "asks for a stop: granted" in log
    done = int(re.findall(r'"steps": (\d+)', (training.run / "metrics.jsonl").read_text())[-1])
    assert (training.run / f"checkpoints/step-{done:09d}/policy.safetensors").is_file()
    for each in (viewer, operator):
        assert_whole(each)
        each.type("q")
        assert each.end() == 0 and each.restored()
