"""Every command line of pages and help pages: parsed to the end, and run where that costs little.

The rule stands in docs/documentation.md.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path

import pytest

from lndrl.cli.help import EXAMPLES
from lndrl.cli.main import run as lndrl
from tests.docs.conftest import Followed
from tests.docs.doing import FOLLOWED, as_it_stands, shape
from tests.docs.pages import PAGES, ROOT, Command, command_lines, commands, name_of
from tests.docs.parse import faults

ALL = [command for page in PAGES for command in commands(page)]
OF_HELP = [
    Command(f"help of {name or 'lndrl'}", 1, tuple(shlex.split(example.line)), True)
    for name, examples in EXAMPLES.items()
    for example in examples
]
RUN = sorted(
    {
        shape(each.words): each.words
        for each in (*OF_HELP, *ALL)
        if each.block and as_it_stands(each.words)
    }.values()
)
"""One of each shape."""


@pytest.mark.parametrize("page", [*map(name_of, PAGES), "help"])
def test_every_command_line_is_one_of_the_program(
    page: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found = OF_HELP if page == "help" else [each for each in ALL if each.page == page]
    wrong = [f"{each}: {fault}" for each in found for fault in faults(each.words, not each.block)]
    capsys.readouterr()  # a group that is named alone shows its help
    assert wrong == []


def test_wrong_command_lines_are_seen() -> None:
    for line in (
        "lndrl trian",
        "lndrl train --step 5",
        "lndrl train lndlr",
        "lndrl train --set ppo.epoch=3",
        "lndrl train --set ppo.epochs=few",
        "lndrl train --steps S2",
        "lndrl evaluate dwaa",
        "lndrl evaluate",
        "lndrl evaluate dwa --scenario hal",
        "lndrl benchmark --methods dwa,radnom",
        "lndrl sweep ppoo",
        "lndrl config explain",
        "lndrl config explian ppo",
        "lndrl actor --connect 127.0.0.1",
        "lndrl report docs/results/v9",
    ):
        (words,) = command_lines(line)
        good = line == "lndrl config explain"
        assert bool(faults(words)) is not good, line


def test_commands_are_found_where_they_stand(tmp_path: Path) -> None:
    assert list(command_lines("OMP_NUM_THREADS=1 .venv/bin/lndrl runs  # all | of them")) == [
        ("runs",)
    ]
    assert list(command_lines("lndrl config show lndrl > mine.yaml")) == [
        ("config", "show", "lndrl")
    ]
    assert list(command_lines("lndrl runs && lndrl version | head")) == [("runs",), ("version",)]
    assert list(command_lines("lndrl: planner my_parts:Slow is refused")) == []
    assert len(ALL) > 400 and sum(each.block for each in ALL) > 200


@pytest.mark.parametrize("words", RUN, ids=" ".join)
def test_commands_that_cost_little_run_as_they_stand(
    words: tuple[str, ...],
    filled: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if words[0] == "certs":
        monkeypatch.chdir(tmp_path)
    elif words[:2] == ("runs", "rm"):
        monkeypatch.chdir(shutil.copytree(filled, tmp_path / "copy"))
    else:
        monkeypatch.chdir(filled)
    monkeypatch.setattr("typer.confirm", lambda *_, **__: False)
    assert lndrl(words) == (1 if words[:2] == ("runs", "rm") and "--yes" not in words else 0)
    said = capsys.readouterr().out
    if "--json" in words:
        json.loads(said)  # no line beside it


def test_who_follows_the_tutorial_gets_to_its_end(followed: Followed) -> None:
    assert [command for command, code in followed.codes if code != 0] == []
    names = {command.words[0] for command, _ in followed.codes}
    assert {"train", "runs", "evaluate", "play", "lost"} == names
    for page in FOLLOWED:
        for name in re.findall(r"--out (\S+)", (ROOT / page).read_text()):
            assert (followed.folder / name.replace(".gif", ".png")).exists(), name


def test_targets_of_make_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    known = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    for page in PAGES:
        for target in re.findall(r"(?:^    |`)make ([a-z][a-z-]*)", page.read_text(), re.MULTILINE):
            assert target in known, (name_of(page), target)
